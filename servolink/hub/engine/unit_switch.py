"""UnitSwitch: sets the angle units of the board for whichever program is served (3.2.4)."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from servolink.client.board import Board
from servolink.connection.connection import Connection
from servolink.errors import Rejected, RequestError
from servolink.hub.rules.session_state import SessionState
from servolink.hub.rules.units import BoardUnits
from servolink.protocol.packet import Packet
from servolink.protocol.servos import SetAngleUnitRequest, SetAngleUnitResponse


class UnitsKept(RequestError):
    """The angle units of the board must not be changed while another program runs what is stored."""

    def __init__(self, packet: Packet) -> None:
        """Store `packet`, which was not sent."""
        super().__init__("another program runs what is stored, and its angles are in other units than yours", packet)


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

        Raise UnitsKept, Rejected or RequestTimeout if that fails: then the packet must not be sent.
        """
        if not self.enter_at_once(packet, state):
            async with self._setting:
                # Also nothing of others may be under way: a query that is repeated would be answered in other units.
                await self._until_unused(lambda: self._may_set_needed(packet, state))
                await self._set_needed(packet, state)
                self._users += 1

    def is_set_for(self, packet: Packet, state: SessionState) -> bool:
        """Return whether the units are as `packet` means them, and nobody is about to set others."""
        self._look_at_connection()
        return not self._setting.locked() and not self._units.needed(packet, state)

    def enter_at_once(self, packet: Packet, state: SessionState) -> bool:
        """Return whether the units are as `packet` means them; if so, they are kept until `leave`."""
        is_set = self.is_set_for(packet, state)
        self._users += is_set
        return is_set

    def leave(self) -> None:
        """Allow other units: the packet was answered, or will not be."""
        self._users -= 1
        if not self._users:
            self._unused.set()

    async def set(self, packet: SetAngleUnitRequest, state: SessionState) -> SetAngleUnitResponse:
        """Set a unit that a program asks for. If the board accepts it, it is that of the program from now on.

        Raise UnitsKept if that must not be now, unless the program has this unit already.
        """
        async with self._setting:
            await self._until_unused(lambda: self._may_set(packet, state))
            if self._may_set(packet, state):
                response = await self._ask(packet)
                if self._units.answered(packet, response):
                    state.set_unit(packet)
                return response
        if state.is_set(packet):
            return SetAngleUnitResponse(packet.servo_id, packet.unit_type)
        raise UnitsKept(packet)

    def keep_for(self, state: SessionState, until: float) -> None:
        """Keep the units of a program with `state` while its macro runs (see `BoardUnits.keep_for`)."""
        self._units.keep_for(state, until)
        self._unused.set()  # who waits for other units need not wait any more

    def release(self) -> None:
        """Keep no units for a macro any more: the board is stopped."""
        self._units.release()

    def rested(self) -> None:
        """Keep no units for a macro of unknown end any more: the servos rest."""
        self._units.rested()

    async def _set_needed(self, packet: Packet, state: SessionState) -> None:
        self._look_at_connection()
        while needed := self._units.needed(packet, state):
            if not self._may_set_needed(packet, state):
                raise UnitsKept(packet)
            for request in needed:
                if not self._units.answered(request, await self._ask(request)):
                    raise Rejected(f"the board refused the angle unit of servo {request.servo_id}", request)
            self._look_at_connection()  # and begin again with a new one

    def _look_at_connection(self) -> None:
        """Forget the units that were set on another connection: the board may have been switched off and on."""
        if self._board.connection is not self._connection:
            self._connection = self._board.connection
            self._units.forget()

    def _may_set(self, request: SetAngleUnitRequest, state: SessionState) -> bool:
        return self._units.may_set(request, state, asyncio.get_running_loop().time())

    def _may_set_needed(self, packet: Packet, state: SessionState) -> bool:
        return all(self._may_set(request, state) for request in self._units.needed(packet, state))

    async def _ask(self, request: SetAngleUnitRequest) -> SetAngleUnitResponse:
        self._units.asking(request)
        try:
            # Not past the board's own methods: they check limits in the units that they know.
            return await self._board.request(request, unchecked=True)
        except BaseException:
            self._units.forget()  # as the board's methods do, which will set those of all servos again
            raise

    async def _until_unused(self, may_set: Callable[[], bool]) -> None:
        """Wait until nothing under way depends on the units, or they must not be set at all."""
        while self._users and may_set():
            self._unused.clear()
            await self._unused.wait()
