"""VirtualBoard: a servo control board without hardware, as a state machine without input, output or clock.

Hosts are attached as sessions: bytes go in, bytes come out.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

from servolink.errors import DecodeError
from servolink.protocol.codec import Codec
from servolink.protocol.frame import OVERHEAD, Frame, encode_frame
from servolink.protocol.packet import Packet
from servolink.protocol.parser import FrameParser
from servolink.protocol.settings import ClearAllDataRequest, TransmissionModeSettingRequest
from servolink.virtual.handlers import HANDLERS, RequestContext
from servolink.virtual.hardware import NEW_PROTOCOL, Hardware
from servolink.virtual.kind import DEFAULT_KIND, BoardKind
from servolink.virtual.storage import Contents, partial_write

_SILENCE = 0.25  # seconds after which half a frame is given up


class VirtualBoard(Hardware):
    """A board with `servos` servos, numbered from 1; `kind` says how it differs from others.

    It handles requests one after the other, in the order in which they came. A request takes effect when the board
    begins to work on it, and is answered when the board has finished: at once, unless its kind takes time. The requests
    that come meanwhile wait, and those for which there is no room are lost.

    A write counts as under way until the host has received the whole response. If power is lost before, a board without
    `partial_writes` has finished the write; one with them may hold anything that `storage.partial_write` describes. Of
    several writes that a host requested at once, only the last one begun can be interrupted.
    """

    def __init__(
        self,
        servos: int = 16,
        seed: int = 0,
        codec: Codec | None = None,
        kind: BoardKind = DEFAULT_KIND,
    ) -> None:
        """Switch on. Boards with the same `seed` behave the same. Raise ValueError for a value out of range."""
        super().__init__(servos, kind, seed=seed, codec=codec, send_event=self._send_event)
        self.sessions: list[HostSession] = []
        """The hosts that are attached."""
        self.work = WorkQueue(kind.queue)
        """The requests that were received."""

    def attach(self, send: Callable[[bytes], None], unsent: Callable[[], int] = lambda: 0) -> HostSession:
        """Attach a host, and switch the power on if it was off.

        `send` takes the board's frames and must not raise; `unsent` returns how many of the bytes that it took have not
        reached the host. Neither is called after `detach`.
        """
        if not self.powered:
            self.switch(on=True)
        session = HostSession(self, send, unsent)
        self.sessions.append(session)
        return session

    def detach(self, *sessions: HostSession, now: float | None = None) -> None:
        """Detach hosts, all at once; without `now`, at the time that the board was passed last."""
        if now is not None:
            self.advance(now)
        present = [session for session in sessions if session in self.sessions]
        for session in present:
            self.sessions.remove(session)
        if self.kind.bus_powered and not self.sessions:
            self._lose_power(present)

    def power_cycle(self, now: float) -> None:
        """Interrupt the power: servos stop, and everything that is not stored is lost. Hosts stay attached."""
        self.advance(now)
        self._lose_power(self.sessions)
        self.switch(on=True)

    def _advance_to(self, due: float, now: float) -> None:
        super()._advance_to(due, now)
        if self.work.due == due:
            for servo in self.servos.values():  # the next request may ask for their state
                servo.advance(due)
            self.work.end(due)
            self.notify_watchers()  # a request that waited may have stored something

    def _due(self) -> float | None:
        due, work_due = super()._due(), self.work.due
        return due if work_due is None else work_due if due is None else min(due, work_due)

    def _lose_power(self, sessions: list[HostSession]) -> None:
        """Switch off; `sessions` are those whose writes may have been under way."""
        for session in sessions:
            write = session.unconfirmed_write
            # A later write, of another host, says that this one was finished.
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


@dataclass(slots=True)
class StoredChange:
    """A change of what is stored."""

    before: Contents
    after: Contents
    confirmed_at: float = math.inf
    """How many bytes the host must have received to have the whole response; infinite until it is sent."""


class HostSession:
    """One host's conversation with the board."""

    def __init__(self, board: VirtualBoard, send: Callable[[bytes], None], unsent: Callable[[], int]) -> None:
        """Use `board.attach`."""
        self.board = board
        self.subscribed = False
        """Whether button events are sent to this host."""
        self.waiting = 0
        """The bytes of its requests that wait."""
        self._parser = FrameParser(board.codec.byte_order)
        self._last_receive = 0.0
        self._send = send
        self._unsent = unsent
        self._sent = 0  # bytes
        self._last_write: StoredChange | None = None

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes from the host, cut and damaged anyhow, and respond to the requests that are now complete.

        Empty `data` says that more of them may have waited until now: the host is not silent.
        """
        self.board.advance(now)
        if data and now - self._last_receive >= _SILENCE:
            # Half a frame and then silence: its sender is gone or has given up, but the length that it claims could
            # swallow everything that the next host sends. A host that only paused loses one request and asks again.
            while self._parser.partial_frame is not None:
                self._take(self._parser.abandon_frame(), now)
        self._last_receive = now
        if self.board.kind.takes_time and len(data) > self._room:
            self._receive_part(data, now)
        else:
            self._take(self._parser.feed(data), now)
        self.board.notify_watchers()

    def detach(self, now: float | None = None) -> None:
        """Detach from the board; requests that were not complete get no response."""
        self.board.detach(self, now=now)

    def send(self, frame: bytes) -> None:
        """Send `frame` to the host."""
        self._sent += len(frame)
        self._send(frame)

    def reset(self) -> None:
        """Forget half a frame and the subscription, as a board that has lost its power does."""
        self.subscribed = False
        self._parser = FrameParser(self.board.codec.byte_order)

    @property
    def unconfirmed_write(self) -> StoredChange | None:
        """The last write, None if the host has received its whole response."""
        write = self._last_write
        received = self._sent - self._unsent()
        return None if write is None or received >= write.confirmed_at else write

    def finish(self, frame: bytes) -> None:
        """Send the response to the request that was carried out last, unless the host has detached."""
        if self not in self.board.sessions:
            return
        write = self._last_write
        if write is not None and write.confirmed_at == math.inf:
            write.confirmed_at = self._sent + len(frame)
        self.send(frame)

    def respond(self, packet_id: int, content: bytes, now: float) -> tuple[bytes | None, float]:
        """Carry out a request; return the frame to send, if there is one, and the seconds of work before that."""
        board, codec = self.board, self.board.codec
        try:
            request = codec.decode(packet_id, content)
        except DecodeError:
            return None, 0.0  # its count contradicts its length: a board cannot respond to what it cannot read
        handler = HANDLERS.get(type(request))
        if handler is None or board.kind.ignores(request):
            return None, 0.0  # a response, which only boards send, or unsupported
        if board.mode != NEW_PROTOCOL and not isinstance(request, TransmissionModeSettingRequest):
            return None, 0.0
        before = board.storage.contents
        response = handler(RequestContext(board, self, request, content, now))
        seconds = board.kind.turnaround
        if board.storage.contents is not before:
            self._last_write = StoredChange(before, board.storage.contents)
            is_clear = isinstance(request, ClearAllDataRequest)
            seconds += board.kind.clear_seconds if is_clear else board.kind.write_seconds
        if isinstance(response, bool):
            response = bytes((response,))
        return None if response is None else self._encode(packet_id, response), seconds

    def _encode(self, packet_id: int, response: Packet | bytes) -> bytes:
        codec = self.board.codec
        if isinstance(response, Packet):
            return codec.encode(response)
        return encode_frame(packet_id + 1, response, codec.byte_order)

    def _take(self, frames: Iterable[Frame], now: float) -> None:
        for packet_id, content in frames:
            if self in self.board.sessions:  # sending a response can detach the host
                self.board.work.take(ReceivedRequest(self, packet_id, content), now)

    @property
    def _room(self) -> int:
        """How many bytes find room while the board works."""
        partial = self._parser.partial_frame
        return max(0, self.board.kind.queue_bytes - self.waiting - (partial[1] if partial else 0))

    def _receive_part(self, data: bytes, now: float) -> None:
        """Take the bytes for which there is room. An idle board reads each as it comes, so that it needs none."""
        for at in range(len(data)):
            if self.board.work.due is not None:
                self._take(self._parser.feed(data[at : at + self._room]), now)
                return
            self._take(self._parser.feed(data[at : at + 1]), now)


class ReceivedRequest(NamedTuple):
    """A request as it was received."""

    host: HostSession
    packet_id: int
    content: bytes

    @property
    def size(self) -> int:
        """The bytes of its frame."""
        return len(self.content) + OVERHEAD


class WorkQueue:
    """The request that a board works on, and at most `most` that wait."""

    def __init__(self, most: int) -> None:
        """Start without work."""
        self._most = most
        self._waiting: deque[ReceivedRequest] = deque()
        self._response: tuple[HostSession, bytes] | None = None
        self.received = 0
        """How many requests were received, also those that were lost."""
        self.due: float | None = None
        """When the work on a request ends; None if there is none."""

    def take(self, request: ReceivedRequest, now: float) -> None:
        """Work on a request now, or after earlier ones; a request beyond the queue is lost."""
        self.received += 1
        if self.due is None and not self._waiting:  # a host may ask again at once, while others still wait
            self._begin(request, now)
        elif len(self._waiting) < self._most:
            self._waiting.append(request)
            request.host.waiting += request.size

    def end(self, now: float) -> None:
        """End the work on a request, and begin that on the next."""
        response, self._response, self.due = self._response, None, None
        if response is not None:
            host, frame = response
            host.finish(frame)
        while self._waiting and self.due is None:
            request = self._waiting.popleft()
            request.host.waiting -= request.size
            self._begin(request, now)

    def clear(self) -> None:
        """Forget everything: the work has no response, and nothing waits."""
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
