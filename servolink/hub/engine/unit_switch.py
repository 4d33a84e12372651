"""UnitSwitch: sets the angle units of the board for each program, and keeps those of a running macro (3.2.4)."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

from servolink.client import Board, servos_of
from servolink.errors import Reason, Rejected, RequestRefused
from servolink.motion import ServoUnits, is_accepted, servos_concerned
from servolink.protocol import Packet, SetAngleUnitRequest, SetAngleUnitResponse


class UnitsKept(RequestRefused):
    """The angle units of the board must not be changed while another program runs what is stored."""

    def __init__(self, packet: Packet) -> None:
        text = "another program runs a stored record, whose angles are in other units than those of this program"
        super().__init__(text, packet, reason=Reason.ANGLE_UNIT)


class UnitSwitch:
    """Angle units of the board, kept as needed by a program while requests depend on them.

    Angles are never converted. So the board is set to the units of a program before each packet that depends on them.
    """

    def __init__(self, board: Board) -> None:
        self._servos = servos_of(board)
        self._reservation = UnitReservation()
        self._setting = asyncio.Lock()
        self._users = 0
        self._unused = asyncio.Event()

    async def enter(self, packet: Packet, units: ServoUnits) -> None:
        """Set the units of a program for `packet`, and keep the units until `leave`.

        Raise UnitsKept, Rejected or RequestTimeout if that fails: then the packet must not be sent.
        """
        if not self.enter_at_once(packet, units):
            async with self._setting:
                # Requests of other programs must be finished: a repeated query would be answered in other units.
                await self._until_unused(lambda: self._may_set(self._needed(packet, units), units))
                await self._set_needed(packet, units)
                self._users += 1

    def is_set_for(self, packet: Packet, units: ServoUnits) -> bool:
        """Return whether the units needed by `packet` are set, and no others are about to be set."""
        return not self._setting.locked() and not self._needed(packet, units)

    def enter_at_once(self, packet: Packet, units: ServoUnits) -> bool:
        """Return whether the units for `packet` are set, and if so keep the units until `leave`."""
        is_set = self.is_set_for(packet, units)
        self._users += is_set
        return is_set

    def leave(self) -> None:
        """Allow other units: the packet was answered, or will not be."""
        self._users -= 1
        if not self._users:
            self._unused.set()

    async def set(self, packet: SetAngleUnitRequest, units: ServoUnits) -> SetAngleUnitResponse:
        """Set a unit for a program, and note the unit in `units` if the board accepts.

        Raise UnitsKept if it must not be set now, unless the program has this unit already.
        """
        async with self._setting:
            await self._until_unused(lambda: self._may_set((packet,), units))
            if self._may_set((packet,), units):
                response = await self._ask(packet)
                if is_accepted(packet, response):
                    units.set(packet)
                return response
        if units.has(packet):
            return SetAngleUnitResponse(packet.servo_id, packet.unit_type)
        raise UnitsKept(packet)

    def keep_for(self, units: ServoUnits, until: float) -> None:
        """Keep the units of a program while its macro runs (see `UnitReservation.keep_for`)."""
        self._reservation.keep_for(units, until)
        self._unused.set()  # programs that wait for other units may go on

    def release(self) -> None:
        """Keep no units for a macro any more: the board is stopped."""
        self._reservation.release()

    def rested(self) -> None:
        """Keep no units for a macro of unknown end any more: the servos rest."""
        self._reservation.rested()

    async def _set_needed(self, packet: Packet, units: ServoUnits) -> None:
        while needed := self._needed(packet, units):
            if not self._may_set(needed, units):
                raise UnitsKept(packet)
            for request in needed:
                if not is_accepted(request, await self._ask(request)):
                    raise Rejected(f"the board refused the angle unit of servo {request.servo_id}", request)

    def _needed(self, packet: Packet, units: ServoUnits) -> tuple[SetAngleUnitRequest, ...]:
        return self._servos.units.current.needed(units, servos_concerned(packet))

    def _may_set(self, requests: tuple[SetAngleUnitRequest, ...], units: ServoUnits) -> bool:
        now = asyncio.get_running_loop().time()
        return all(self._reservation.allows(request, units, now) for request in requests)

    async def _ask(self, request: SetAngleUnitRequest) -> SetAngleUnitResponse:
        # Through the units of the board, which limits are checked in.
        response = await self._servos.units.answer_to(request)
        if not is_accepted(request, response):
            # On a bad line, the board may have set the unit all the same.
            self._servos.units.current.forget(request.servo_id)
        return response

    async def _until_unused(self, may_set: Callable[[], bool]) -> None:
        """Wait until no request under way depends on the units, or until setting units is refused."""
        while self._users and may_set():
            self._unused.clear()
            await self._unused.wait()


class UnitReservation:
    """Units that nobody may change, because the macro of a program depends on the units."""

    def __init__(self) -> None:
        self._units: ServoUnits | None = None
        self._until = 0.0

    def keep_for(self, units: ServoUnits, until: float) -> None:
        """Keep the units of a program while a macro runs, until `until` or a stop.

        `until` is infinite while it is unknown. The board reads each step of a macro when it comes to it, in the unit
        that the servo is set to then.
        """
        self._units, self._until = units, until

    def release(self) -> None:
        """Keep no units any more: the macro was stopped."""
        self._units = None

    def rested(self) -> None:
        """Keep no units for a macro of unknown end any more: the servos rest."""
        if self._until == math.inf:
            self._units = None

    def allows(self, request: SetAngleUnitRequest, units: ServoUnits, now: float) -> bool:
        """Return whether a unit may be set for the program with `units`, without spoiling another program's macro."""
        if self._units is None or self._units is units or now >= self._until:
            return True
        return self._units.has(request)
