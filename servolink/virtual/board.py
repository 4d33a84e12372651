"""VirtualBoard: a servo control board without hardware, as a state machine without input, output or clock.

Time is passed in as seconds of any monotonic clock. Hosts are attached as sessions: bytes go in, bytes come out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from random import Random

from servolink.errors import DecodeError
from servolink.protocol.codec import Codec
from servolink.protocol.frame import encode_frame
from servolink.protocol.packet import Packet
from servolink.protocol.parser import FrameParser
from servolink.protocol.settings import TransmissionModeSettingRequest
from servolink.virtual.buttons import Buttons
from servolink.virtual.handlers import ANSWERS, Asked
from servolink.virtual.player import Player
from servolink.virtual.servo import Servo
from servolink.virtual.storage import Add, Clear, Contents, Storage, tear

MEMORY = 64 * 1024
MOST_SERVOS = 254
"""Ids are one byte, 0 says "no such servo" and 255 means all."""
NEW_PROTOCOL = 1

_FULL = 1000.0  # battery, per mille
_STANDBY = _FULL / (10 * 3600)  # an idle board lasts ten hours
_PER_CHARGE = _FULL / (2000.0 * 3600)  # a current of 2000 raw ADC lasts an hour
_SILENCE = 0.25


@dataclass(frozen=True, slots=True)
class _Write:
    """A change of what is stored."""

    before: Contents
    after: Contents
    answered: int
    """How many bytes have been said to the host with its answer."""


class VirtualBoard:
    """A board with `servos` servos, numbered from 1, and `memory` bytes for what is stored.

    Boards differ in what adding an id does that is stored already (`add`), in what clearing leaves (`clear`), in
    whether they lose their power with their last host (`reboot`), and in what is then left of a write (`torn`).

    There is no clock in the board, so a write takes no time, and is under way as long as its answer is: from the last
    byte of the request until the host has all of the answer. When the power goes in between, a board that is not
    `torn` has done it, and of one that is anything may be left that `servolink.virtual.tearing` says. Of several writes
    that a host asked for at once, those before the last are done.
    """

    def __init__(
        self,
        servos: int = 16,
        seed: int = 0,
        codec: Codec | None = None,
        memory: int = MEMORY,
        *,
        add: Add = "replace",
        clear: Clear = "all",
        torn: bool = False,
        reboot: bool = False,
    ) -> None:
        """Boards with the same `seed` are the same, also in how they tear; ValueError names a value out of range."""
        if not 0 <= servos <= MOST_SERVOS:
            raise ValueError(f"{servos} servos are outside 0..{MOST_SERVOS}")
        self._random = random = Random(seed)  # noqa: S311 - servos that differ a little, no secrets
        self.codec = codec or Codec()
        self.servos = {
            servo_id: Servo(servo_id, angle=float(random.randint(-10, 10)), friction=random.uniform(0.9, 1.1))
            for servo_id in range(1, servos + 1)
        }
        self.storage = Storage(memory, add=add, clear=clear)
        self.player = Player(self.servos, self.storage, self.codec)
        self.mode = NEW_PROTOCOL
        self.battery = _FULL
        """Remaining charge, per mille."""
        self._buttons = Buttons(self.storage, self.player, self.codec, self._push)
        self.sessions: list[Session] = []
        """The hosts that are connected."""
        self._watchers: list[Callable[[], None]] = []
        self._now: float | None = None
        self._torn = torn
        self._reboot = reboot
        self.powered = True
        """Whether it runs; a board that is powered by its hosts does not between the last one and the next."""

    def attach(self, send: Callable[[bytes], None], waiting: Callable[[], int] = lambda: 0) -> Session:
        """Connect a host, and give power if there was none.

        `send` takes what the board has to say to the host and must not raise; `waiting` tells how many bytes of all
        that it took have not reached the host. Neither is called after `detach`.
        """
        if not self.powered:
            self._switch(on=True)
        session = Session(self, send, waiting)
        self.sessions.append(session)
        return session

    def detach(self, *sessions: Session, now: float | None = None) -> None:
        """Disconnect hosts, all at once; without `now`, at the last time that the board was told."""
        if now is not None:
            self.advance(now)
        there = [session for session in sessions if session in self.sessions]
        for session in there:
            self.sessions.remove(session)
        if self._reboot and not self.sessions:
            self._lose_power(there)

    def power_cycle(self, now: float) -> None:
        """Let the power go and come back, whoever is connected: servos stop, what is not stored is forgotten."""
        self.advance(now)
        self._lose_power(self.sessions)
        self._switch(on=True)

    def press_button(self, button_id: int, now: float) -> None:
        """Let a button go down; nothing happens without power."""
        self.advance(now)
        if self.powered:
            self._buttons.press(button_id, now)
        self.changed()

    def release_button(self, button_id: int, now: float) -> None:
        """Let a button come up; it counts as a long press when it was down for 0.8 s."""
        self.advance(now)
        self._buttons.release(button_id, now)
        self.changed()

    def push_servo(self, servo_id: int, degree: float, now: float) -> None:
        """Turn a servo by hand to an angle; one that is held does not give way, and one that is not there cannot."""
        self.advance(now)
        if servo_id in self.servos:
            self.servos[servo_id].push(degree)
        self.changed()

    def advance(self, now: float) -> None:
        """Bring everything that goes on by itself up to `now`; a time before the last one changes nothing."""
        while (due := self._due()) is not None and due <= now:
            self._buttons.advance(due)
            self.player.advance(due, now)
        last = self._now
        if last is None or now > last:
            for servo in self.servos.values():
                servo.advance(now)
            self._drain(0.0 if last is None else now - last)
            self._now = now

    def next_due(self, now: float) -> float | None:
        """Return when `advance` has something to do by itself, never before `now`; None if nothing is under way."""
        due = self._due()
        return None if due is None else max(due, now)

    def watch(self, changed: Callable[[], None]) -> None:
        """Call `changed` whenever `next_due` may have changed from outside."""
        self._watchers.append(changed)

    def unwatch(self, changed: Callable[[], None]) -> None:
        """Undo `watch`."""
        self._watchers.remove(changed)

    def changed(self) -> None:
        """Tell those who watch that something came from outside."""
        for changed in list(self._watchers):
            changed()

    def _due(self) -> float | None:
        return min((due for due in (self._buttons.due, self.player.due) if due is not None), default=None)

    def _lose_power(self, sessions: list[Session]) -> None:
        """Stop, with `sessions` as the hosts that were there."""
        for session in sessions:
            write = session._unanswered  # noqa: SLF001 - sessions are part of the board
            if self._torn and write is not None and write.after is self.storage.contents:
                self.storage.contents = tear(write.before, write.after, self._random, self.codec.byte_order)
            session.forget()
        self.player.stop()
        self._buttons.forget()
        self.mode = NEW_PROTOCOL
        self._switch(on=False)
        self.changed()

    def _switch(self, *, on: bool) -> None:
        self.powered = on
        for servo in self.servos.values():
            servo.switch(on=on)

    def _drain(self, elapsed: float) -> None:
        drawn = sum(servo.take_charge() for servo in self.servos.values())
        self.battery = max(0.0, self.battery - elapsed * _STANDBY - drawn * _PER_CHARGE)

    def _push(self, frame: bytes) -> None:
        if self.mode == NEW_PROTOCOL:
            for session in list(self.sessions):
                if session.subscribed:
                    session.say(frame)


class Session:
    """One host's conversation with the board."""

    def __init__(self, board: VirtualBoard, send: Callable[[bytes], None], waiting: Callable[[], int]) -> None:
        """Use `board.attach`."""
        self.board = board
        self.send = send
        self.subscribed = False
        """Whether button events are pushed to it."""
        self._parser = FrameParser(board.codec.byte_order)
        self._heard = 0.0
        self._waiting = waiting
        self._said = 0  # bytes
        self._write: _Write | None = None  # the last one that it asked for

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes from the host, cut and damaged anyhow, and answer the requests that are now complete."""
        self.board.advance(now)
        frames = []
        if now - self._heard >= _SILENCE:
            # Half a frame and then silence: its sender is gone or has given up, but the claimed length could
            # swallow everything a new host says. A host that only paused loses one request and asks again.
            while self._parser.begun is not None:
                frames += self._parser.give_up()
        self._heard = now
        for packet_id, content in frames + self._parser.feed(data):
            if self in self.board.sessions:
                self._answer(packet_id, content, now)
        self.board.changed()

    def detach(self, now: float | None = None) -> None:
        """Disconnect; whatever was received and not answered yet stays unanswered."""
        self.board.detach(self, now=now)

    def say(self, frame: bytes) -> None:
        """Send `frame` to the host."""
        self._said += len(frame)
        self.send(frame)

    def forget(self) -> None:
        """Know nothing of what the host said before."""
        self.subscribed = False
        self._parser = FrameParser(self.board.codec.byte_order)

    @property
    def _unanswered(self) -> _Write | None:
        """The last write, unless the host has all of its answer."""
        write = self._write
        return None if write is None or self._said - self._waiting() >= write.answered else write

    def _answer(self, packet_id: int, content: bytes, now: float) -> None:
        codec, storage = self.board.codec, self.board.storage
        try:
            packet = codec.decode(packet_id, content)
        except DecodeError:
            return  # a count that lies about the length: a board cannot answer what it cannot read
        handler = ANSWERS.get(type(packet))
        if handler is None:
            return  # an answer, which only boards send
        if self.board.mode != NEW_PROTOCOL and not isinstance(packet, TransmissionModeSettingRequest):
            return
        before = storage.contents
        answer = handler(Asked(self, packet, content, now))
        if isinstance(answer, Packet):
            frame = codec.encode(answer)
        elif answer is not None:
            frame = encode_frame(packet_id + 1, answer, codec.byte_order)
        else:
            return
        if storage.contents is not before:
            self._write = _Write(before, storage.contents, self._said + len(frame))
        self.say(frame)
