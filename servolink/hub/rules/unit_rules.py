"""UnitReservation: angle units that must stay while a macro runs (3.2.4)."""

from __future__ import annotations

import math

from servolink.motion import ServoUnits
from servolink.protocol import SetAngleUnitRequest


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
