"""VirtualBoard: a servo control board without hardware, as a state machine without input, output or clock.

Time is passed in as seconds of any monotonic clock. Hosts are attached as sessions: bytes go in, bytes come out.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from servolink.errors import DecodeError
from servolink.protocol.codec import Codec
from servolink.protocol.frame import encode_frame
from servolink.protocol.packet import Packet
from servolink.protocol.parser import FrameParser
from servolink.protocol.settings import TransmissionModeSettingRequest
from servolink.virtual.answers import ANSWERS, Asked
from servolink.virtual.buttons import Buttons
from servolink.virtual.player import Player
from servolink.virtual.servo import Servo
from servolink.virtual.storage import Storage

MEMORY = 64 * 1024
MOST_SERVOS = 254
"""Ids are one byte, 0 says "no such servo" and 255 means all."""
NEW_PROTOCOL = 1

_FULL = 1000.0  # battery, per mille
_STANDBY = _FULL / (10 * 3600)  # an idle board lasts ten hours
_PER_CHARGE = _FULL / (2000.0 * 3600)  # a current of 2000 raw ADC lasts an hour
_SILENCE = 0.25


class VirtualBoard:
    """A board with `servos` servos, numbered from 1, and `memory` bytes for what is stored."""

    def __init__(self, servos: int = 16, seed: int = 0, codec: Codec | None = None, memory: int = MEMORY) -> None:
        """Boards with the same `seed` are the same; ValueError for less than 0 or more than 254 servos."""
        if not 0 <= servos <= MOST_SERVOS:
            raise ValueError(f"{servos} servos are outside 0..{MOST_SERVOS}")
        random = Random(seed)  # noqa: S311 - servos that differ a little, no secrets
        self.codec = codec or Codec()
        self.servos = {
            servo_id: Servo(servo_id, angle=float(random.randint(-10, 10)), friction=random.uniform(0.9, 1.1))
            for servo_id in range(1, servos + 1)
        }
        self.storage = Storage(memory)
        self.player = Player(self.servos, self.storage, self.codec)
        self.mode = NEW_PROTOCOL
        self.battery = _FULL
        """Remaining charge, per mille."""
        self._buttons = Buttons(self.storage, self.player, self.codec, self._push)
        self.sessions: list[Session] = []
        """The hosts that are connected."""
        self._watchers: list[Callable[[], None]] = []
        self._now: float | None = None

    def attach(self, send: Callable[[bytes], None]) -> Session:
        """Connect a host; `send` takes what the board has to say to it and must not raise."""
        session = Session(self, send)
        self.sessions.append(session)
        return session

    def detach(self, session: Session) -> None:
        """Disconnect a host; the board forgets its subscription."""
        if session in self.sessions:
            self.sessions.remove(session)

    def press_button(self, button_id: int, now: float) -> None:
        """Let a button go down."""
        self.advance(now)
        self._buttons.press(button_id, now)
        self.changed()

    def release_button(self, button_id: int, now: float) -> None:
        """Let a button come up; it counts as a long press when it was down for 0.8 s."""
        self.advance(now)
        self._buttons.release(button_id, now)
        self.changed()

    def advance(self, now: float) -> None:
        """Bring everything that goes on by itself up to `now`; a time before the last one changes nothing."""
        if self._now is None:
            self._now = now
        while (due := self._due()) is not None and due <= now:
            self._buttons.advance(due)
            self.player.advance(due, now)
        for servo in self.servos.values():
            servo.advance(now)
        self._drain(max(0.0, now - self._now))
        self._now = max(self._now, now)

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

    def _drain(self, elapsed: float) -> None:
        drawn = sum(servo.take_charge() for servo in self.servos.values())
        self.battery = max(0.0, self.battery - elapsed * _STANDBY - drawn * _PER_CHARGE)

    def _push(self, frame: bytes) -> None:
        if self.mode == NEW_PROTOCOL:
            for session in list(self.sessions):
                if session.subscribed:
                    session.send(frame)


class Session:
    """One host's conversation with the board."""

    def __init__(self, board: VirtualBoard, send: Callable[[bytes], None]) -> None:
        """Use `board.attach`."""
        self.board = board
        self.send = send
        self.subscribed = False
        """Whether button events are pushed to it."""
        self._parser = FrameParser(board.codec.byte_order)
        self._heard = 0.0
        self._attached = True

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
            if self._attached:
                self._answer(packet_id, content, now)
        self.board.changed()

    def detach(self) -> None:
        """Disconnect; whatever was received and not answered yet stays unanswered."""
        self._attached = False
        self.board.detach(self)

    def _answer(self, packet_id: int, content: bytes, now: float) -> None:
        codec = self.board.codec
        try:
            packet = codec.decode(packet_id, content)
        except DecodeError:
            return  # a count that lies about the length: a board cannot answer what it cannot read
        handler = ANSWERS.get(type(packet))
        if handler is None:
            return  # an answer, which only boards send
        if self.board.mode != NEW_PROTOCOL and not isinstance(packet, TransmissionModeSettingRequest):
            return
        answer = handler(Asked(self, packet, content, now))
        if isinstance(answer, Packet):
            self.send(codec.encode(answer))
        elif answer is not None:
            self.send(encode_frame(packet_id + 1, answer, codec.byte_order))
