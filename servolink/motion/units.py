"""Units in which the angles of each servo are sent and reported (3.2.4), and the packets that depend on them."""

from __future__ import annotations

from collections.abc import Set as AbstractSet

from msgspec import Struct, field

from servolink.motion.angles import AngleUnit
from servolink.protocol import (
    ALL_SERVOS,
    ExecuteActionRequest,
    Packet,
    QueryServoRequest,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    SetServoParameterRequest,
)


class ServoUnits(Struct):
    """Unit of each servo, as set on a board or as meant by a program.

    Angles are never converted: the document does not say how degrees and ADC relate.
    """

    common: AngleUnit | None = None
    """Unit of all servos that are not in `own`; None for an unknown unit."""
    own: dict[int, AngleUnit | None] = field(default_factory=dict)
    """Units of servos that may differ from `common`, by servo id; None for an unknown unit."""

    def of(self, servo_id: int) -> AngleUnit | None:
        """Return the unit of a servo, None if it is unknown."""
        return self.own.get(servo_id, self.common)

    def has(self, request: SetAngleUnitRequest) -> bool:
        """Return whether `request` would change nothing."""
        if request.servo_id == ALL_SERVOS:
            return not self.own and self.common == _unit_in(request)
        return self.of(request.servo_id) == _unit_in(request)

    def set(self, accepted: SetAngleUnitRequest) -> None:
        """Store the unit that a board accepted for a servo or for all."""
        unit = _unit_in(accepted)
        if accepted.servo_id == ALL_SERVOS:
            self.own.clear()
            self.common = unit
        elif unit == self.common:
            self.own.pop(accepted.servo_id, None)
        else:
            self.own[accepted.servo_id] = unit

    def forget(self, servo_id: int = ALL_SERVOS) -> None:
        """Count the unit of a servo, or of all, as unknown: a lost response proves nothing."""
        if servo_id == ALL_SERVOS:
            self.own.clear()
            self.common = None
        else:
            self.own[servo_id] = None

    def needed(self, target: ServoUnits, servo_ids: AbstractSet[int] | None = None) -> tuple[SetAngleUnitRequest, ...]:
        """Return the ordered requests that bring a board with these units to the `target` units.

        Only `servo_ids` matter, None for all servos. Each request must be accepted, and no packet that depends on units
        may be under way meanwhile.
        """
        # A servo that has a different unit on either side exists: the board accepted the unit. Any other servo may be
        # missing, and a board rejects a unit for a missing servo. So the other servos are set all together.
        existing = target.own.keys() | {servo_id for servo_id, unit in self.own.items() if unit is not None}
        others = (self.own.keys() if servo_ids is None else servo_ids) - existing
        if target.common is not None and (
            (servo_ids is None and self.common != target.common)
            or any(self.of(servo_id) != target.common for servo_id in others)
        ):
            after = sorted(target.own if servo_ids is None else target.own.keys() & servo_ids)
            return (unit_request(ALL_SERVOS, target.common), *_requests(target, after))
        concerned = sorted(existing if servo_ids is None else existing & servo_ids)
        return _requests(target, [servo_id for servo_id in concerned if self.of(servo_id) != target.of(servo_id)])


def unit_request(servo_id: int, unit: AngleUnit) -> SetAngleUnitRequest:
    """Return the request that sets the unit of a servo (255: all)."""
    return SetAngleUnitRequest(servo_id, int(unit == "adc"))


def is_accepted(request: SetAngleUnitRequest, response: SetAngleUnitResponse) -> bool:
    """Return whether the board has set the unit in `request`."""
    return (response.servo_id, response.unit_type) == (request.servo_id, request.unit_type)


def carries_angles(packet: Packet) -> bool:
    """Return whether the meaning of `packet`, or of its response, depends on the angle unit of servos (3.2.4).

    That is so for angles sent and reported, and for everything stored that the board applies to its servos.
    """
    if isinstance(packet, SetServoParameterRequest):
        return False
    return packet.is_motion or isinstance(packet, QueryServoRequest)


def servos_concerned(packet: Packet) -> AbstractSet[int] | None:
    """Return the servos whose units matter for `packet` or its response; None for all servos."""
    if not carries_angles(packet):
        return set()
    if isinstance(packet, ExecuteActionRequest):
        named = {step.servo_id for step in packet.steps}
    elif isinstance(packet, QueryServoRequest):
        named = {packet.servo_id}
    else:  # a stored record, whose servos are unknown
        return None
    return None if ALL_SERVOS in named else named


def _unit_in(request: SetAngleUnitRequest) -> AngleUnit:
    return "adc" if request.unit_type else "degree"


def _requests(units: ServoUnits, servo_ids: list[int]) -> tuple[SetAngleUnitRequest, ...]:
    return tuple(unit_request(servo_id, unit) for servo_id in servo_ids if (unit := units.of(servo_id)) is not None)
