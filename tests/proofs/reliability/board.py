"""A simulated board behind a bad line: in order, one thing after the other, and sometimes late, deaf or double.

Every answer tells which sending it answers, as far as the packet has room for it (tests/client/numbered_board.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Protocol

from servolink.errors import DecodeError
from servolink.protocol import HEADER_SIZE, ButtonEventResponse, Codec, Frame, FrameParser, Packet, Request, Response
from tests.client.numbered_board import numbered
from tests.proofs.reliability.line import Direction, Line
from tests.proofs.reliability.witness import Witness

LATENCY = 0.004
_LATE_BY = (0.1, 1.5)
_DOWN_FOR = (0.3, 3.0)
_PIECES_APART = (0.001, 0.03)
_IN_PIECES = 0.05  # chance that an answer comes in two
_PUSHED = 0.02  # chance, per request, of a button event
_SILENCE = 0.25  # after which half a frame is given up, as the virtual board does
_NEVER = float("inf")


@dataclass(frozen=True, slots=True)
class Character:
    """What is wrong with a board; chances are per request."""

    name: str
    late: float = 0.0
    lost: float = 0.0
    """A request is not taken, or as often is done and not answered."""
    twice: float = 0.0
    """An answer is sent twice."""
    up_for: tuple[float, float] | None = None
    """Seconds from one restart to the next; what it had not answered it forgets. None: for ever."""


BOARDS = (
    Character("prompt"),
    Character("slow 3 %", late=0.03),
    Character("lossy 1 %, slow 3 %", late=0.03, lost=0.01),
    Character("restarts, slow 1 %", late=0.01, up_for=(5.0, 60.0)),
    Character("responds twice 0.1 %, slow 1 %", late=0.01, twice=0.001),
)


class Wire(Protocol):
    """What leads from the board to the program."""

    @property
    def now(self) -> float:
        """The time."""
        ...

    def bring(self, when: float, data: bytes) -> None:
        """Bring `data` at that time; times never decrease."""


class Judge(Protocol):
    """Who knows what was sent, and judges what is done."""

    def executes(self, number: int | None, packet: Packet) -> int:
        """Note what the board does, and return the number that its answer must show; None: nobody sent this."""
        ...

    def arrives(self, number: int, when: float | None) -> None:
        """Note when the answer to a sending will have arrived whole; None if it never will."""


class SimulatedBoard:
    """Takes bytes, and lays what it says on a wire."""

    def __init__(
        self,
        character: Character,
        line: Line,
        codec: Codec,
        random: Random,
        wire: Wire,
        checker: Judge,
        response: Callable[[Packet, int], Response] = numbered,
    ) -> None:
        """Draw everything that goes wrong from `random`; `response` makes the response to a sending."""
        self.to_board, self.to_host = Witness(), Witness()
        self.free_at = wire.now
        """When everything that it was asked so far is answered."""
        self.character = character
        """How it behaves from now on."""
        self._codec = codec
        self._random = random
        self._wire = wire
        self._checker = checker
        self._response = response
        self._down_line, self._up_line = Direction(line, random), Direction(line, random)
        self._parser = FrameParser(codec.byte_order)
        self._heard_at = wire.now
        self._fails_at = self._next_failure(wire.now)
        self._back_at = 0.0

    def heal(self) -> None:
        """Be prompt on a clean line from now on."""
        self.character = BOARDS[0]
        self._fails_at = _NEVER
        self._down_line = self._up_line = Direction(Line(""), self._random)

    def carry(self, packet_id: int, frame: bytes, number: int) -> bytes:
        """Return what arrives here of a frame of the program, the sending with this number."""
        arriving, whole = self._down_line.carry(frame)
        if whole and self._is_up():
            self.to_board.expect((packet_id, frame[HEADER_SIZE:-1]), number)
        return arriving

    def receive(self, data: bytes) -> None:
        """Do what is asked, and say the answers when they are ready."""
        if not self._is_up():
            return
        frames: list[Frame] = []
        now = self._wire.now
        if now - self._heard_at >= _SILENCE:
            while self._parser.partial_frame is not None:
                frames += self._parser.abandon_frame()
        self._heard_at = now
        for frame in frames + self._parser.feed(data):
            number = self.to_board.recognise(frame)
            try:
                packet = self._codec.decode(*frame)
            except DecodeError:
                continue
            self._take(packet, number, max(now, self.free_at))

    def _is_up(self) -> bool:
        now = self._wire.now
        if now >= self._fails_at and not self._back_at:
            self._back_at = self._fails_at + self._random.uniform(*_DOWN_FOR)
        if not self._back_at:
            return True
        if now < self._back_at:
            return False
        self._parser = FrameParser(self._codec.byte_order)
        self.to_board.forget()
        self._fails_at = self._next_failure(self._back_at)
        self._back_at = 0.0
        self.free_at = now
        return self._is_up()

    def _next_failure(self, since: float) -> float:
        up_for = self.character.up_for
        return since + self._random.uniform(*up_for) if up_for else _NEVER

    def _take(self, packet: Packet, number: int | None, begins: float) -> None:
        chance = self._random.random()
        character = self.character
        if begins >= self._fails_at or chance < character.lost:
            return
        number = self._checker.executes(number, packet)
        if not isinstance(packet, Request) or chance < 2 * character.lost:
            return
        ready = begins + LATENCY
        if self._random.random() < character.late:
            ready += self._random.uniform(*_LATE_BY)
        if self._random.random() < _PUSHED:
            self._say(ButtonEventResponse(number, 1), begins, 0)
        arrives = self._say(self._response(packet, number), ready, number)
        self._checker.arrives(number, arrives)
        if self._random.random() < character.twice:
            self._say(self._response(packet, number), self.free_at, number)

    def _say(self, packet: Packet, ready: float, number: int) -> float | None:
        """Say `packet` at `ready`, unless there is a restart before; return when it has arrived whole."""
        if ready >= self._fails_at:
            return None
        frame = self._codec.encode(packet)
        arriving, whole = self._up_line.carry(frame)
        if whole:
            self.to_host.expect((packet.packet_id, frame[HEADER_SIZE:-1]), number)
        pieces = [arriving]
        if self._random.random() < _IN_PIECES and arriving:
            at = self._random.randrange(len(arriving))
            pieces = [arriving[:at], arriving[at:]]
        for piece in pieces:
            self.free_at = max(self.free_at, ready)
            if piece:
                self._wire.bring(self.free_at, piece)
            ready = self.free_at + self._random.uniform(*_PIECES_APART)
        return self.free_at if whole else None
