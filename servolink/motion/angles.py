"""Angles: whole numbers with a unit, the values sent for them, and the unit of each servo on a board (3.2.4)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from collections.abc import Set as AbstractSet
from typing import ClassVar, Literal, Self

from msgspec import Struct, field

from servolink.errors import EncodeError, quote
from servolink.protocol import (
    ALL_SERVOS,
    ExecuteActionRequest,
    Packet,
    QueryServoRequest,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    SetServoParameterRequest,
)
from servolink.support import as_number, is_number

AngleUnit = Literal["degree", "adc"]

_LEAST, _GREATEST = -0x8000, 0x7FFF  # in the field of a packet
_TURN_DEGREES = 360


class Angle(int):
    """Whole number with a unit. `str` gives the number; `repr` shows the unit.

    It adds to and compares with plain numbers and angles in the same unit. Raise TypeError for another unit.
    """

    unit: ClassVar[str] = ""

    def _same_unit(self, other: object) -> None:
        if isinstance(other, Angle) and type(other) is not type(self):
            raise TypeError(f"{self!r} and {other!r} are in different units")

    def _whole(self, other: int) -> int:
        self._same_unit(other)
        number = as_number(other)
        if not isinstance(number, int):
            raise TypeError(f"only whole numbers can be added to {self!r}, not {other!r}")
        return int(number)

    def __add__(self, other: int, /) -> Self:
        """Return the sum, in the same unit. Raise TypeError for a fraction."""
        return type(self)(int(self) + self._whole(other))

    def __sub__(self, other: int, /) -> Self:
        """Return the difference, in the same unit. Raise TypeError for a fraction."""
        return type(self)(int(self) - self._whole(other))

    __radd__ = __add__

    def __rsub__(self, other: int, /) -> Self:
        """Return the difference, in the unit of this angle."""
        return -self + other

    def __neg__(self) -> Self:
        """Return the opposite angle."""
        return type(self)(-int(self))

    def __lt__(self, other: int, /) -> bool:
        """Compare. Raise TypeError for another unit."""
        self._same_unit(other)
        return int(self) < other

    def __le__(self, other: int, /) -> bool:
        """Compare. Raise TypeError for another unit."""
        self._same_unit(other)
        return int(self) <= other

    def __gt__(self, other: int, /) -> bool:
        """Compare. Raise TypeError for another unit."""
        self._same_unit(other)
        return int(self) > other

    def __ge__(self, other: int, /) -> bool:
        """Compare. Raise TypeError for another unit."""
        self._same_unit(other)
        return int(self) >= other

    def __eq__(self, other: object, /) -> bool:
        """Compare. Angles in different units are never equal."""
        if isinstance(other, Angle) and type(other) is not type(self):
            return False
        return int(self) == other

    def __ne__(self, other: object, /) -> bool:
        """Compare as angles; the operator of `int` ignores units."""
        return not self == other

    def __hash__(self) -> int:
        """Return the hash of the number, because both are equal."""
        return hash(int(self))

    def __str__(self) -> str:
        """Return the number alone, so that CSV files, logs and f-strings hold numbers."""
        return int.__repr__(self)

    def __repr__(self) -> str:
        """Return number and unit, such as `Degrees(90)`."""
        return f"{type(self).__name__}({int(self)})"


class Degrees(Angle):
    """An angle in degrees."""

    unit: ClassVar[str] = "degree"

    @property
    def is_beyond(self) -> bool:
        """Whether the angle is beyond a full turn; a reported one may be in another unit."""
        return not -_TURN_DEGREES <= int(self) <= _TURN_DEGREES


class Adc(Angle):
    """An angle as the raw reading of the servo's analog-to-digital converter."""

    unit: ClassVar[str] = "adc"


def in_unit(value: int, unit: AngleUnit | None) -> int:
    """Return `value` as an angle in `unit`, or unchanged if the unit is unknown."""
    return value if unit is None else {"degree": Degrees, "adc": Adc}[unit](value)


def wire_angle(value: float, unit: AngleUnit | None, servo_id: int) -> int:
    """Return the number to send to a servo set to `unit`.

    Raise EncodeError for an angle in another unit, and outside -32768..32767.
    """
    where = f"servo {servo_id}"
    if isinstance(value, Angle):
        if value.unit != unit:
            raise EncodeError(
                f"{where}: {quote(value)} was given, but this servo is set to {unit or 'an unknown unit'}"
            )
    elif unit == "adc":
        raise EncodeError(f"{where}: {quote(value)} was given, but this servo is set to adc; write Adc({quote(value)})")
    if not is_number(value) or value != value // 1:
        raise EncodeError(
            f"{where}: the angle must be a whole number, not {quote(value)}; the protocol has no fractions"
        )
    if not _LEAST <= value <= _GREATEST:
        raise EncodeError(f"{where}: the angle {quote(value)} is outside {_LEAST}..{_GREATEST}")
    return int(value)


def wire_angles(targets: Mapping[int, float], unit_of: Callable[[int], AngleUnit | None]) -> dict[int, int]:
    """Return the numbers to send for `targets`. Raise EncodeError for an angle in a wrong unit."""
    return {servo_id: wire_angle(value, unit_of(servo_id), servo_id) for servo_id, value in targets.items()}


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
