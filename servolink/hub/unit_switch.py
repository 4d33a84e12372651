"""UnitSwitch: sets the angle units of the board for whichever program is served (3.2.4)."""

from __future__ import annotations

import asyncio

from servolink.client.board import Board
from servolink.connection.connection import Connection
from servolink.errors import Rejected
from servolink.hub.session_state import SessionState
from servolink.hub.units import BoardUnits
from servolink.protocol.packet import Packet
from servolink.protocol.servos import SetAngleUnitRequest, SetAngleUnitResponse


class UnitSwitch:
    """Keeps the units as one program means them while anything of it is under way that depends on them."""

    def __init__(self, board: Board) -> None:
        """Set units on `board`. Nothing else may set them."""
        self._board = board
        self._units = BoardUnits()
        self._connection: Connection | None = None  # to which `_units` belong
        self._setting = asyncio.Lock()
        self._users = 0
        self._unused = asyncio.Event()

    async def enter(self, packet: Packet, state: SessionState) -> None:
        """Set what `packet` of a program means, and keep it until `leave`.

        Raise Rejected or RequestTimeout if that fails: then the packet must not be sent.
        """
        if self._board.connection is not self._connection:
            self._connection = self._board.connection
            self._units.forget()  # the board may have been switched off and on
        if self._setting.locked() or self._units.needed(packet, state):
            async with self._setting:
                # Also nothing of others may be under way: a query that is repeated would be answered in other units.
                await self._until_unused()
                for request in self._units.needed(packet, state):
                    if not self._units.answered(request, await self._ask(request)):
                        raise Rejected(f"the board refused the angle unit of servo {request.servo_id}", request)
                self._users += 1
        else:
            self._users += 1

    def leave(self) -> None:
        """Allow other units: the packet was answered, or will not be."""
        self._users -= 1
        if not self._users:
            self._unused.set()

    async def set(self, packet: SetAngleUnitRequest, state: SessionState) -> SetAngleUnitResponse:
        """Set a unit that a program asks for. If the board accepts it, it is that of the program from now on."""
        async with self._setting:
            await self._until_unused()
            response = await self._ask(packet)
            if self._units.answered(packet, response):
                state.set_unit(packet)
        return response

    async def _ask(self, request: SetAngleUnitRequest) -> SetAngleUnitResponse:
        self._units.asking(request)
        # Not past the board's own methods: they check limits in the units that they know.
        return await self._board.request(request, unchecked=True)

    async def _until_unused(self) -> None:
        while self._users:
            self._unused.clear()
            await self._unused.wait()
