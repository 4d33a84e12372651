"""VirtualBoard: a servo control board without hardware, as a state machine without input, output or clock.

Hosts are attached as sessions: bytes go in, bytes come out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from servolink.errors import DecodeError
from servolink.protocol.codec import Codec
from servolink.protocol.frame import encode_frame
from servolink.protocol.packet import Packet
from servolink.protocol.parser import FrameParser
from servolink.protocol.settings import TransmissionModeSettingRequest
from servolink.virtual.handlers import HANDLERS, RequestContext
from servolink.virtual.hardware import MEMORY, NEW_PROTOCOL, Hardware
from servolink.virtual.storage import Clear, Contents, OnDuplicate, Storage, partial_write

_SILENCE = 0.25  # seconds after which half a frame is given up


class VirtualBoard(Hardware):
    """A board with `servos` servos, numbered from 1, and `memory` bytes for what is stored.

    Boards differ in what adding a stored id does (`on_duplicate`), in what clearing leaves (`clear`), in whether they
    lose power with their last host (`bus_powered`), and in what an interrupted write leaves (`partial_writes`).

    The board has no clock, so a write takes no time. It counts as under way from the last byte of the request until
    the host has received the whole response. If power is lost in between, a board without `partial_writes` has
    finished the write; one with them may hold anything that `storage.partial_write` describes. Of several writes that
    a host requested at once, only the last can be interrupted.
    """

    def __init__(
        self,
        servos: int = 16,
        seed: int = 0,
        codec: Codec | None = None,
        memory: int = MEMORY,
        *,
        on_duplicate: OnDuplicate = "replace",
        clear: Clear = "all",
        partial_writes: bool = False,
        bus_powered: bool = False,
    ) -> None:
        """Switch on. Boards with the same `seed` behave the same. Raise ValueError for a value out of range."""
        storage = Storage(memory, on_duplicate=on_duplicate, clear=clear)
        super().__init__(servos, storage, seed=seed, codec=codec, send_event=self._send_event)
        self.sessions: list[Session] = []
        """The hosts that are attached."""
        self._partial_writes = partial_writes
        self._bus_powered = bus_powered

    def attach(self, send: Callable[[bytes], None], unsent: Callable[[], int] = lambda: 0) -> Session:
        """Attach a host, and switch the power on if it was off.

        `send` takes the board's frames and must not raise; `unsent` returns how many of the bytes that it took have not
        reached the host. Neither is called after `detach`.
        """
        if not self.powered:
            self.switch(on=True)
        session = Session(self, send, unsent)
        self.sessions.append(session)
        return session

    def detach(self, *sessions: Session, now: float | None = None) -> None:
        """Detach hosts, all at once; without `now`, at the time that the board was passed last."""
        if now is not None:
            self.advance(now)
        present = [session for session in sessions if session in self.sessions]
        for session in present:
            self.sessions.remove(session)
        if self._bus_powered and not self.sessions:
            self._lose_power(present)

    def power_cycle(self, now: float) -> None:
        """Interrupt the power: servos stop, and everything that is not stored is lost. Hosts stay attached."""
        self.advance(now)
        self._lose_power(self.sessions)
        self.switch(on=True)

    def _lose_power(self, sessions: list[Session]) -> None:
        """Switch off; `sessions` are those whose writes may have been under way."""
        for session in sessions:
            write = session.unconfirmed_write
            # A later write, of another host, says that this one was finished.
            if self._partial_writes and write is not None and write.after is self.storage.contents:
                self.storage.contents = partial_write(write.before, write.after, self._random, self.codec.byte_order)
            session.reset()
        self.switch(on=False)
        self.notify_watchers()

    def _send_event(self, frame: bytes) -> None:
        if self.mode == NEW_PROTOCOL:
            for session in list(self.sessions):
                if session.subscribed:
                    session.send(frame)


@dataclass(frozen=True, slots=True)
class Write:
    """A change of what is stored."""

    before: Contents
    after: Contents
    confirmed_at: int
    """How many bytes the host must have received to have the whole response."""


class Session:
    """One host's conversation with the board."""

    def __init__(self, board: VirtualBoard, send: Callable[[bytes], None], unsent: Callable[[], int]) -> None:
        """Use `board.attach`."""
        self.board = board
        self.subscribed = False
        """Whether button events are sent to this host."""
        self._parser = FrameParser(board.codec.byte_order)
        self._last_receive = 0.0
        self._send = send
        self._unsent = unsent
        self._sent = 0  # bytes
        self._last_write: Write | None = None

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes from the host, cut and damaged anyhow, and respond to the requests that are now complete."""
        self.board.advance(now)
        frames = []
        if now - self._last_receive >= _SILENCE:
            # Half a frame and then silence: its sender is gone or has given up, but the length that it claims could
            # swallow everything that the next host sends. A host that only paused loses one request and asks again.
            while self._parser.partial_frame is not None:
                frames += self._parser.abandon_frame()
        self._last_receive = now
        for packet_id, content in frames + self._parser.feed(data):
            if self in self.board.sessions:  # sending a response can detach the host
                self._respond(packet_id, content, now)
        self.board.notify_watchers()

    def detach(self, now: float | None = None) -> None:
        """Detach from the board; requests that were not complete get no response."""
        self.board.detach(self, now=now)

    def send(self, frame: bytes) -> None:
        """Send `frame` to the host."""
        self._sent += len(frame)
        self._send(frame)

    def reset(self) -> None:
        """Forget half a frame and the subscription, as a board does that lost its power."""
        self.subscribed = False
        self._parser = FrameParser(self.board.codec.byte_order)

    @property
    def unconfirmed_write(self) -> Write | None:
        """The last write, None if the host has received its whole response."""
        write = self._last_write
        received = self._sent - self._unsent()
        return None if write is None or received >= write.confirmed_at else write

    def _respond(self, packet_id: int, content: bytes, now: float) -> None:
        board, codec = self.board, self.board.codec
        try:
            request = codec.decode(packet_id, content)
        except DecodeError:
            return  # its count contradicts its length: a board cannot respond to what it cannot read
        handler = HANDLERS.get(type(request))
        if handler is None:
            return  # a response, which only boards send
        if board.mode != NEW_PROTOCOL and not isinstance(request, TransmissionModeSettingRequest):
            return
        before = board.storage.contents
        response = handler(RequestContext(board, self, request, content, now))
        if response is None:
            return
        if isinstance(response, Packet):
            frame = codec.encode(response)
        else:
            content = bytes((response,)) if isinstance(response, bool) else response
            frame = encode_frame(packet_id + 1, content, codec.byte_order)
        if board.storage.contents is not before:
            self._last_write = Write(before, board.storage.contents, self._sent + len(frame))
        self.send(frame)
