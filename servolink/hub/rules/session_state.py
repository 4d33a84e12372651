"""What belongs to one program and must not leak into another: mode, angle units, subscription."""

from __future__ import annotations

from servolink.motion.angles import AngleUnit
from servolink.protocol.servos import ALL_SERVOS, SetAngleUnitRequest


class SessionState:
    """The state that a board keeps for its only program, kept here for one of many."""

    def __init__(self, unit: AngleUnit = "degree") -> None:
        """Begin like a board after power-up, with all servos set to `unit`."""
        self.unit: AngleUnit = unit
        """The unit of all servos without one of their own."""
        self.units: dict[int, AngleUnit] = {}
        """By servo id, the unit of those that were set to one of their own."""
        self.mode = 1
        """The transmission mode (3.1.1): in mode 0 the program is sent nothing but the response that sets mode 1."""
        self.is_subscribed = False
        """Whether button events are sent to it (3.4.7)."""

    def unit_of(self, servo_id: int) -> AngleUnit:
        """Return the unit in which the program sends and reads the angle of a servo."""
        return self.units.get(servo_id, self.unit)

    def is_set(self, request: SetAngleUnitRequest) -> bool:
        """Return whether the program has the unit that `request` asks for already."""
        if request.servo_id == ALL_SERVOS:
            return not self.units and self.unit == unit_of(request)
        return self.unit_of(request.servo_id) == unit_of(request)

    def set_unit(self, accepted: SetAngleUnitRequest) -> None:
        """Remember a unit that the program asked for and the board accepted (3.2.4)."""
        unit = unit_of(accepted)
        if accepted.servo_id == ALL_SERVOS:
            self.units.clear()
            self.unit = unit
        elif unit == self.unit:
            self.units.pop(accepted.servo_id, None)
        else:
            self.units[accepted.servo_id] = unit


def unit_of(request: SetAngleUnitRequest) -> AngleUnit:
    """Return the unit that a request asks for."""
    return "adc" if request.unit_type else "degree"


class Subscribers:
    """Counts the programs with button events: the first one subscribes the board, the last one ends that (3.4.7).

    Requests of 40070 must be sent one after the other, since a repeated one would undo a later one.
    """

    def __init__(self) -> None:
        """Start without subscribers, on a board whose subscription is unknown."""
        self._programs: set[str] = set()
        self._is_on: bool | None = None

    @property
    def is_wanted(self) -> bool:
        """Whether a program wants button events, so that a new connection must subscribe again."""
        return bool(self._programs)

    def __contains__(self, session_id: str) -> bool:
        """Return whether button events are sent to a program."""
        return session_id in self._programs

    def must_ask(self, session_id: str, *, subscribe: bool) -> bool:
        """Return whether the board must be asked before a program is answered; if not, the answer is success."""
        if subscribe:
            return self._is_on is not True
        return self._is_on is not False and not self._programs - {session_id}

    def asking(self) -> None:
        """Count the subscription of the board as unknown: it is asked to change it, or was connected again."""
        self._is_on = None

    def answered(self, *, subscribe: bool) -> None:
        """Count a change that the board has carried out."""
        self._is_on = subscribe

    def change(self, session_id: str, *, subscribe: bool) -> None:
        """Add or remove a program, once the board has carried out what `must_ask` wanted of it."""
        if subscribe:
            self._programs.add(session_id)
        else:
            self._programs.discard(session_id)

    def left(self, session_id: str) -> bool:
        """Remove a program that is gone. Return whether the board must be asked to end its subscription."""
        was_subscribed = session_id in self._programs
        self._programs.discard(session_id)
        return was_subscribed and not self._programs and self._is_on is not False
