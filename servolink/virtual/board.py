"""Virtual board: a servo control board without hardware, as a state machine without input, output or clock.

Hosts are attached as sessions: bytes go in, bytes come out.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from msgspec import Struct

from servolink.errors import DecodeError
from servolink.protocol import (
    OVERHEAD,
    ClearAllDataRequest,
    Codec,
    Frame,
    FrameParser,
    Packet,
    TransmissionModeSettingRequest,
    encode_frame,
)
from servolink.virtual.handlers import HANDLERS, RequestContext, Response
from servolink.virtual.hardware import NEW_PROTOCOL, Hardware
from servolink.virtual.kind import BoardKind
from servolink.virtual.storage import Contents, partial_write

_SILENCE = 0.25  # seconds after which an incomplete frame is dropped


class VirtualBoard(Hardware):
    """Board with `servos` servos, numbered from 1; `kind` describes differences from other boards.

    Requests are handled one after the other, in order of arrival. A request takes effect when the board begins to work
    on it, and gets a response when the board has finished: immediately, unless `kind` has working times. Requests
    received meanwhile wait, or are lost if the queue is full.

    A write is unfinished until the host has received the whole response. After a loss of power before, a board without
    `partial_writes` has finished the write; a board with `partial_writes` is in a state as made by
    `storage.partial_write`. Of several writes requested together by a host, only the last begun can be interrupted.
    """

    def __init__(
        self,
        servos: int = 16,
        seed: int = 0,
        codec: Codec | None = None,
        kind: BoardKind = BoardKind.DEFAULT,
    ) -> None:
        """Switch on a board. The same `seed` gives the same behaviour. Raise ValueError for a value out of range."""
        super().__init__(servos, kind, seed=seed, codec=codec, send_event=self._send_event)
        self.sessions: list[HostSession] = []
        """Sessions of all attached hosts."""
        self.work = WorkQueue(kind.queue)
        """Queue of received requests."""

    def attach(
        self,
        send: Callable[[bytes], None],
        unsent: Callable[[], int] = lambda: 0,
        unplugged: Callable[[], None] = lambda: None,
    ) -> HostSession:
        """Attach a host, and switch the power on if necessary.

        `send` receives the frames of the board and must not raise. `unsent` returns the number of bytes passed to
        `send` and not yet received by the host. `unplugged` is called by `unplug`, after the host was detached. Neither
        `send` nor `unsent` is called after `detach`.
        """
        if not self.powered:
            self.switch(on=True)
        session = HostSession(self, send, unsent, unplugged)
        self.sessions.append(session)
        return session

    def detach(self, *sessions: HostSession, now: float | None = None) -> None:
        """Detach hosts together, at the time `now`, by default the last time passed to the board."""
        if now is not None:
            self.advance(now)
        present = [session for session in sessions if session in self.sessions]
        for session in present:
            self.sessions.remove(session)
        if self.kind.bus_powered and not self.sessions:
            self._lose_power(present)

    def unplug(self, now: float | None = None) -> None:
        """Detach all hosts, as if their cables had been pulled: each loses the connection.

        `now` is the time, by default the last time passed to the board.
        """
        sessions = list(self.sessions)
        self.detach(*sessions, now=now)
        # After all are detached: a host may connect again at once, and then stays connected.
        for session in sessions:
            session.unplugged()

    def handle(self, context: RequestContext[Any]) -> tuple[Response, float]:
        """Execute a request; return the response, None without one, and the working time in seconds.

        Boards that misbehave override this method.
        """
        if self.kind.ignores(context.request):
            return None, 0.0
        return HANDLERS[type(context.request)](context), self.kind.turnaround

    def frame(self, packet_id: int, response: Response) -> bytes | None:
        """Return the frame of a response to the request `packet_id`; None without a response."""
        if response is None:
            return None
        if isinstance(response, Packet):
            return self.codec.encode(response)
        content = bytes((response,)) if isinstance(response, bool) else response
        return encode_frame(packet_id + 1, content, self.codec.byte_order)

    def power_cycle(self, now: float) -> None:
        """Interrupt the power: servos stop, and all state outside the storage is lost. Hosts stay attached."""
        self.advance(now)
        self._lose_power(self.sessions)
        self.switch(on=True)

    def _advance_to(self, due: float, now: float) -> None:
        super()._advance_to(due, now)
        if self.work.due == due:
            for servo in self.servos.values():  # the next request may query the state of servos
                servo.advance(due)
            self.work.end(due)
            self.notify_watchers()  # a waiting request may have stored something

    def _due(self) -> float | None:
        due, work_due = super()._due(), self.work.due
        return due if work_due is None else work_due if due is None else min(due, work_due)

    def _lose_power(self, sessions: list[HostSession]) -> None:
        """Switch off; `sessions` may have unfinished writes."""
        for session in sessions:
            write = session.unconfirmed_write
            # A later write, of another host, proves the earlier write finished.
            if self.kind.partial_writes and write is not None and write.after is self.storage.contents:
                self.storage.contents = partial_write(write.before, write.after, self._random, self.codec.byte_order)
            session.reset()
        self.work.clear()
        self.switch(on=False)
        self.notify_watchers()

    def _send_event(self, frame: bytes) -> None:
        if self.mode == NEW_PROTOCOL:
            for session in list(self.sessions):
                if session.subscribed:
                    session.send(frame)


class StoredChange(Struct):
    """Change of the storage by a write."""

    before: Contents
    after: Contents
    confirmed_at: float = math.inf
    """Bytes received by the host at the end of the response; infinite until the response is sent."""


class HostSession:
    """Conversation of a host with the board."""

    def __init__(
        self,
        board: VirtualBoard,
        send: Callable[[bytes], None],
        unsent: Callable[[], int],
        unplugged: Callable[[], None],
    ) -> None:
        """Made by `VirtualBoard.attach` only."""
        self.board = board
        self.unplugged = unplugged
        """Called after the host was detached because the board was unplugged."""
        self.subscribed = False
        """Whether the host receives button events."""
        self.waiting = 0
        """Size of the waiting requests of the host, in bytes."""
        self._parser = FrameParser(board.codec.byte_order)
        self._last_receive = 0.0
        self._send = send
        self._unsent = unsent
        self._sent = 0  # bytes sent to the host
        self._last_write: StoredChange | None = None

    def receive(self, data: bytes, now: float) -> None:
        """Receive bytes from the host, perhaps cut or damaged, and respond to complete requests.

        Empty `data` means that bytes may have been delayed until now: the host does not count as silent.
        """
        self.board.advance(now)
        if data and now - self._last_receive >= _SILENCE:
            # After silence an incomplete frame is dropped: its sender has probably gone, and the claimed length could
            # swallow all bytes of the next host. A host after a mere pause loses one request and repeats the request.
            while self._parser.partial_frame is not None:
                self._take(self._parser.abandon_frame(), now)
        self._last_receive = now
        if self.board.kind.takes_time and len(data) > self._room:
            self._receive_part(data, now)
        else:
            self._take(self._parser.feed(data), now)
        self.board.notify_watchers()

    def detach(self, now: float | None = None) -> None:
        """Detach from the board; unfinished requests get no response."""
        self.board.detach(self, now=now)

    def send(self, frame: bytes) -> None:
        """Send `frame` to the host, and count the bytes."""
        self._sent += len(frame)
        self._send(frame)

    def reset(self) -> None:
        """Forget an incomplete frame and the subscription, as after a loss of power."""
        self.subscribed = False
        self._parser = FrameParser(self.board.codec.byte_order)

    @property
    def unconfirmed_write(self) -> StoredChange | None:
        """Last write, None if the host has received the whole response."""
        write = self._last_write
        received = self._sent - self._unsent()
        return None if write is None or received >= write.confirmed_at else write

    def finish(self, frame: bytes) -> None:
        """Send the response to the last executed request, unless the host has detached."""
        if self not in self.board.sessions:
            return
        write = self._last_write
        if write is not None and write.confirmed_at == math.inf:
            write.confirmed_at = self._sent + len(frame)
        self.send(frame)

    def respond(self, packet_id: int, content: bytes, now: float) -> tuple[bytes | None, float]:
        """Execute a request; return the frame of the response or None, and the working time in seconds."""
        board, codec = self.board, self.board.codec
        try:
            request = codec.decode(packet_id, content)
        except DecodeError:
            return None, 0.0  # count and length contradict each other: an unreadable request gets no response
        if type(request) not in HANDLERS:
            return None, 0.0  # a response
        if board.mode != NEW_PROTOCOL and not isinstance(request, TransmissionModeSettingRequest):
            return None, 0.0
        before = board.storage.contents
        response, seconds = board.handle(RequestContext(board, self, request, content, now))
        if board.storage.contents is not before:
            self._last_write = StoredChange(before, board.storage.contents)
            is_clear = isinstance(request, ClearAllDataRequest)
            seconds += board.kind.clear_seconds if is_clear else board.kind.write_seconds
        return board.frame(packet_id, response), seconds

    def _take(self, frames: Iterable[Frame], now: float) -> None:
        for packet_id, content in frames:
            if self in self.board.sessions:  # sending the response may have detached the host
                self.board.work.take(ReceivedRequest(self, packet_id, content), now)

    @property
    def _room(self) -> int:
        """Number of bytes with room to wait while the board works."""
        partial = self._parser.partial_frame
        return max(0, self.board.kind.queue_bytes - self.waiting - (partial[1] if partial else 0))

    def _receive_part(self, data: bytes, now: float) -> None:
        """Receive as many bytes as have room. An idle board reads each byte on arrival, and needs no room."""
        for at in range(len(data)):
            if self.board.work.due is not None:
                self._take(self._parser.feed(data[at : at + self._room]), now)
                return
            self._take(self._parser.feed(data[at : at + 1]), now)


class ReceivedRequest(NamedTuple):
    """Received request, with its session."""

    host: HostSession
    packet_id: int
    content: bytes

    @property
    def size(self) -> int:
        """Size of the frame, in bytes."""
        return len(self.content) + OVERHEAD


class WorkQueue:
    """Request being executed, and queue of at most `most` waiting requests."""

    def __init__(self, most: int) -> None:
        """Start with no requests."""
        self._most = most
        self._waiting: deque[ReceivedRequest] = deque()
        self._response: tuple[HostSession, bytes] | None = None
        self.received = 0
        """Number of received requests, including lost requests."""
        self.due: float | None = None
        """Time at which the work on the current request ends; None for an idle board."""

    def take(self, request: ReceivedRequest, now: float) -> None:
        """Execute a request now, or after earlier requests; with a full queue the request is lost."""
        self.received += 1
        if (
            self.due is None and not self._waiting
        ):  # otherwise a new request of a host would overtake the waiting requests of others
            self._begin(request, now)
        elif len(self._waiting) < self._most:
            self._waiting.append(request)
            request.host.waiting += request.size

    def end(self, now: float) -> None:
        """End the work on the current request, and begin the next request."""
        response, self._response, self.due = self._response, None, None
        if response is not None:
            host, frame = response
            host.finish(frame)
        while self._waiting and self.due is None:
            request = self._waiting.popleft()
            request.host.waiting -= request.size
            self._begin(request, now)

    def clear(self) -> None:
        """Drop all requests, without responses."""
        for request in self._waiting:
            request.host.waiting = 0
        self._waiting.clear()
        self._response = self.due = None

    def _begin(self, request: ReceivedRequest, now: float) -> None:
        frame, seconds = request.host.respond(request.packet_id, request.content, now)
        if seconds:
            self.due = now + seconds
            self._response = None if frame is None else (request.host, frame)
        elif frame is not None:
            request.host.finish(frame)
