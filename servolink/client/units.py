"""Angle units (3.2.4): which one each servo is set to, and when an angle may be given or read."""

from __future__ import annotations

import asyncio

from servolink.client.angles import AngleUnit
from servolink.client.chapter import Chapter
from servolink.client.link import Link
from servolink.errors import EncodeError, Rejected
from servolink.printable import shown
from servolink.protocol.servos import ALL_SERVOS, SetAngleUnitRequest


class Units(Chapter):
    """The angle units of a board's servos.

    An angle that was worked out or asked for before a unit was sent (`Link.units_sent`) must not be used after it.
    """

    def __init__(self, link: Link, angle_unit: AngleUnit | None) -> None:
        """Set all servos to `angle_unit` before the first command with an angle; None leaves them as they are."""
        super().__init__(link)
        self._unit: AngleUnit | None = angle_unit
        self._units: dict[int, AngleUnit] = {}
        self._unit_is_set = angle_unit is None
        self._setting_unit = asyncio.Lock()

    async def set_angle_unit(self, unit: AngleUnit, servo_id: int = ALL_SERVOS) -> None:
        """Give and report angles of a servo (255: all) in degrees or raw ADC (3.2.4); Rejected if it is refused."""
        if unit not in ("degree", "adc"):
            raise EncodeError(f"unit: {shown(unit)} is neither 'degree' nor 'adc'")
        async with self._setting_unit:
            if servo_id != ALL_SERVOS:
                await self._set_first_unit()
            await self._set_unit(unit, servo_id)

    def unit_of(self, servo_id: int) -> AngleUnit | None:
        """Return the unit in which a servo's angle is given and reported; None if it is not known."""
        return self._units.get(servo_id) or self._unit

    async def _ensure_unit(self) -> None:
        """Wait until units are known: for a change that is under way, and for the first one."""
        if self._unit_is_set and not self._setting_unit.locked():
            return
        async with self._setting_unit:
            await self._set_first_unit()

    async def _set_first_unit(self) -> None:
        """Set the unit of all servos, while nobody else does, unless it is known to be set."""
        if not self._unit_is_set and self._unit is not None:
            await self._set_unit(self._unit, ALL_SERVOS)

    async def _set_unit(self, unit: AngleUnit, servo_id: int) -> None:
        """Set a unit, while nobody else does."""
        link, sent = self._link, self._link.units_sent
        try:
            await _ask(link, unit, servo_id)
        except Rejected:
            raise
        except BaseException:
            if link.units_sent != sent:  # it may have been done: all are set again before the next angle
                self._units.clear()
                self._unit_is_set = self._unit is None
            raise
        if servo_id == ALL_SERVOS:
            self._units.clear()
            self._unit, self._unit_is_set = unit, True
        else:
            self._units[servo_id] = unit

    async def _restore_units(self, link: Link) -> None:
        """Set on a new link the units that were set on the one before it; Rejected if the board does not take them."""
        if not self._unit_is_set:
            return
        units: dict[int, AngleUnit] = {} if self._unit is None else {ALL_SERVOS: self._unit}
        units |= self._units
        for servo_id, unit in units.items():
            await _ask(link, unit, servo_id)


async def _ask(link: Link, unit: AngleUnit, servo_id: int) -> None:
    """Set the unit of a servo; Rejected if the board answers that it is in another."""
    request = SetAngleUnitRequest(servo_id, int(unit == "adc"))
    answer = await link.request(request)
    if (answer.servo_id, answer.unit_type) != (servo_id, request.unit_type):
        raise Rejected(
            f"servo {servo_id} was asked for angle unit {request.unit_type}; the board answered "
            f"servo {answer.servo_id}, unit {answer.unit_type}",
            request,
        )
