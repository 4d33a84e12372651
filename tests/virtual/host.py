"""A host for tests: speaks packets with a virtual board, at times that the test names."""

from __future__ import annotations

from typing import TypeVar, cast

from servolink.protocol import (
    AddActionRequest,
    AddMacroRequest,
    FrameParser,
    MacroCommand,
    Packet,
    QueryServoRequest,
    Request,
    Response,
    ServoState,
    Step,
)
from servolink.virtual.board import VirtualBoard

R = TypeVar("R", bound=Response)
START = 1000.0
"""Any time will do; one that is not 0 finds more."""


class Host:
    """One session and all that the board said in it."""

    def __init__(self, board: VirtualBoard) -> None:
        self.board = board
        self.heard: list[Packet] = []
        self._parser = FrameParser(board.codec.byte_order)
        self.session = board.attach(self._hear)

    def _hear(self, data: bytes) -> None:
        self.heard += [self.board.codec.decode(*frame) for frame in self._parser.feed(data)]

    def tell(self, packet: Packet, now: float = START) -> list[Packet]:
        """Send `packet` and return what the board said meanwhile."""
        before = len(self.heard)
        self.session.receive(self.board.codec.encode(packet), now)
        return self.heard[before:]

    def ask(self, request: Request[R], now: float = START) -> R:
        """Send `request` and return its one answer."""
        (answer,) = (said for said in self.tell(request, now) if said.packet_id == request.packet_id + 1)
        return cast("R", answer)

    def servo(self, servo_id: int, now: float) -> ServoState:
        """Return the state of one servo."""
        return self.ask(QueryServoRequest(servo_id), now).servos[0]

    def angle(self, servo_id: int, now: float) -> int:
        """Return the angle of one servo."""
        return self.servo(servo_id, now).angle

    def store_action(self, action_id: int, *steps: tuple[int, int, int]) -> None:
        """Store an action from servo, degree and interval."""
        packet = AddActionRequest(action_id, f"action {action_id}", tuple(Step(*step) for step in steps))
        assert self.ask(packet).result == 1

    def store_macro(self, macro_id: int, *commands: MacroCommand) -> None:
        """Store a macro."""
        assert self.ask(AddMacroRequest(macro_id, f"macro {macro_id}", commands)).result == 1
