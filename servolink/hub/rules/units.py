"""BoardUnits: the angle units that are set on the board, and what must be set before a packet of a program (3.2.4)."""

from __future__ import annotations

import math

from servolink.control.roles import carries_angles
from servolink.hub.rules.session_state import SessionState, unit_of
from servolink.motion.angles import AngleUnit
from servolink.protocol.packet import Packet
from servolink.protocol.servos import (
    ALL_SERVOS,
    ExecuteActionRequest,
    QueryServoRequest,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
)


class BoardUnits:
    """Tracks the units of the board across programs that want different ones.

    Angles are never converted: the document does not say how degrees and ADC relate. So the board is set to the units
    of a program before each packet of it that depends on them.
    """

    def __init__(self) -> None:
        """Start with all units unknown: a board keeps them when a program ends."""
        self._all: AngleUnit | None = None
        self._units: dict[int, AngleUnit | None] = {}  # of servos that may differ from `_all`
        self._runs: SessionState | None = None  # of the program whose macro runs
        self._runs_until = 0.0

    def of(self, servo_id: int) -> AngleUnit | None:
        """Return the unit of a servo, None if it is unknown."""
        return self._units.get(servo_id, self._all)

    def forget(self) -> None:
        """Count all units as unknown, as on a board that was connected again."""
        self._all = None
        self._units.clear()

    def asking(self, request: SetAngleUnitRequest) -> None:
        """Count the units that `request` sets as unknown until it is answered: a lost response proves nothing."""
        if request.servo_id == ALL_SERVOS:
            self.forget()
        else:
            self._units[request.servo_id] = None

    def answered(self, request: SetAngleUnitRequest, response: SetAngleUnitResponse) -> bool:
        """Return whether the board accepted `request`. If so, its units are known from now on."""
        if (response.servo_id, response.unit_type) != (request.servo_id, request.unit_type):
            return False
        unit = unit_of(request)
        if request.servo_id == ALL_SERVOS:
            self._all = unit
        elif unit == self._all:
            self._units.pop(request.servo_id, None)
        else:
            self._units[request.servo_id] = unit
        return True

    def needed(self, packet: Packet, state: SessionState) -> tuple[SetAngleUnitRequest, ...]:
        """Return what must be sent, in this order, before `packet` of a program with `state`; empty if nothing.

        Each of them must be accepted, and nothing that carries angles may be under way meanwhile.
        """
        if not carries_angles(packet):
            return ()
        named = _named(packet)
        # A servo with a unit of its own, here or there, exists: the board has accepted it. Others may not, and a board
        # rejects a unit for a servo that it does not have. So those are set together with all.
        known = {servo_id for servo_id, unit in self._units.items() if unit is not None}
        own = state.units.keys() | known
        others = (self._units.keys() if named is None else named) - own
        if (named is None and self._all != state.unit) or any(self.of(servo_id) != state.unit for servo_id in others):
            after = sorted(state.units if named is None else named & state.units.keys())
            return (_request(ALL_SERVOS, state.unit), *(_request(one, state.units[one]) for one in after))
        concerned = sorted(own if named is None else own & named)
        return tuple(_request(one, state.unit_of(one)) for one in concerned if self.of(one) != state.unit_of(one))

    def keep_for(self, state: SessionState, until: float) -> None:
        """Keep the units of a program with `state` while its macro runs, until `until` or until it is stopped.

        `until` is infinite while it is unknown. The board reads each step of a macro when it comes to it, in the unit
        that the servo is set to then.
        """
        self._runs, self._runs_until = state, until

    def release(self) -> None:
        """Keep no units any more: the macro was stopped."""
        self._runs = None

    def rested(self) -> None:
        """Keep no units for a macro of unknown end any more: the servos rest."""
        if self._runs_until == math.inf:
            self._runs = None

    def may_set(self, request: SetAngleUnitRequest, state: SessionState, now: float) -> bool:
        """Return whether a unit may be set for a program with `state`, without spoiling the macro of another one."""
        if self._runs is None or self._runs is state or now >= self._runs_until:
            return True
        return self._runs.is_set(request)


def _named(packet: Packet) -> set[int] | None:
    """Return the servos that a packet is about, None for all of them."""
    if isinstance(packet, ExecuteActionRequest):
        named = {step.servo_id for step in packet.steps}
    elif isinstance(packet, QueryServoRequest):
        named = {packet.servo_id}
    else:  # something stored, whose servos are not known
        return None
    return None if ALL_SERVOS in named else named


def _request(servo_id: int, unit: AngleUnit) -> SetAngleUnitRequest:
    return SetAngleUnitRequest(servo_id, int(unit == "adc"))
