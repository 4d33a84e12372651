"""Servos that are limp for a while, and are held again whatever happens."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from servolink.client.board import Board
from servolink.client.servos import Servo
from servolink.errors import ConnectionLost, OutcomeUnknown, RequestTimeout

_PAUSE = 0.2  # seconds before a board that does not answer is asked again


class Limp:
    """Releases servos and holds them again where they are."""

    def __init__(self, board: Board, servos: Sequence[Servo]) -> None:
        """`servos` as they are before they are released."""
        self._board = board
        self._servos = servos
        self.words = "servos " + ", ".join(str(servo.servo_id) for servo in servos)

    async def release(self) -> None:
        """Let them go limp."""
        for servo in self._servos:
            await self._board.release(servo.servo_id)

    async def hold(self) -> None:
        """Hold all of them, stopped, and only then let those be moved again that could be before.

        A servo that is started may go on to where it was told to go last; one that is held first stays where it is.
        """
        for servo in self._servos:
            await self._board.set_servo(servo.servo_id, start=False, hold=True)
        for servo in self._servos:
            if servo.is_start:
                await self._board.set_servo(servo.servo_id, start=True, hold=True)

    async def hold_when_back(self) -> None:
        """Hold them as soon as the board is there, however long that takes."""
        while True:
            try:
                await self.hold()
            except ConnectionLost:
                await self._reconnected()
            except (OutcomeUnknown, RequestTimeout):
                await asyncio.sleep(_PAUSE)
            else:
                return

    async def _reconnected(self) -> None:
        async for state in self._board.states():
            if state == "connected":
                return
