"""Angles, limits and durations: everything that is checked and computed before a movement is sent."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, Self, TypeGuard

from servolink.errors import EncodeError
from servolink.escaping import quote


def is_number(value: object) -> TypeGuard[float]:
    """Return whether `value` is an int or a float; bools do not count as numbers."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def flag(name: str, value: object) -> int:
    """Return 1 for True and 0 for False. Raise EncodeError for anything else."""
    if not isinstance(value, int) or value not in {0, 1}:
        raise EncodeError(f"{name} must be True or False, not {quote(value)}")
    return int(value)


AngleUnit = Literal["degree", "adc"]


class Angle(int):
    """A whole number with a unit. It prints as the number alone; `repr` shows the unit.

    It adds to and compares with plain numbers and angles in the same unit. Raise TypeError for another unit.
    """

    unit: ClassVar[str] = ""

    def _same_unit(self, other: object) -> None:
        if isinstance(other, Angle) and type(other) is not type(self):
            raise TypeError(f"{self!r} and {other!r} are in different units")

    def _whole(self, other: int) -> int:
        self._same_unit(other)
        if not isinstance(other, int):
            raise TypeError(f"only whole numbers can be added to {self!r}, not {other!r}")
        return int(other)

    def __add__(self, other: int, /) -> Self:
        """Return the sum, in this unit. Raise TypeError for a fraction."""
        return type(self)(int(self) + self._whole(other))

    def __sub__(self, other: int, /) -> Self:
        """Return the difference, in this unit. Raise TypeError for a fraction."""
        return type(self)(int(self) - self._whole(other))

    __radd__ = __add__

    def __rsub__(self, other: int, /) -> Self:
        """Return the difference, in this unit."""
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
        """Compare; the operator that `int` has ignores units."""
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


class Adc(Angle):
    """An angle as the raw reading of the servo's analog-to-digital converter."""

    unit: ClassVar[str] = "adc"


def in_unit(value: int, unit: AngleUnit | None) -> int:
    """Return `value` as an angle in `unit`, or unchanged if the unit is unknown."""
    return value if unit is None else {"degree": Degrees, "adc": Adc}[unit](value)


def wire_angle(value: float, unit: AngleUnit | None, servo_id: int) -> int:
    """Return the number to send to a servo set to `unit`. Raise EncodeError for an angle in another unit."""
    where = f"servo {servo_id}"
    if isinstance(value, Angle):
        if value.unit != unit:
            raise EncodeError(
                f"{where}: {quote(value)} was given, but this servo is set to {unit or 'an unknown unit'}"
            )
    elif unit == "adc":
        raise EncodeError(f"{where}: {quote(value)} was given, but this servo is set to adc; write Adc({quote(value)})")
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value // 1:
        raise EncodeError(
            f"{where}: the angle must be a whole number, not {quote(value)}; the protocol has no fractions"
        )
    return int(value)


_INTERVALS_PER_SECOND = 100  # the protocol counts time in units of 10 ms
_LONGEST = 0x7FFF

AngleLimits = Mapping[int, tuple[float, float]] | tuple[float, float]
"""Lowest and highest angle in degrees: by servo id, or one pair for all servos."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """How far and how fast this program may move servos. Without arguments there are no limits."""

    angles: AngleLimits | None = None
    speed_cap: float | None = None
    """Highest speed of any servo, in degrees per second."""

    def __post_init__(self) -> None:
        """Raise EncodeError for limits that allow nothing or name no servo, TypeError for values of a wrong type."""
        if self.speed_cap is not None:
            _check_cap(self.speed_cap)
        if isinstance(self.angles, Mapping):
            for servo_id, pair in self.angles.items():
                _check_servo_id("angle_limits", servo_id)
                _check_pair(pair)
            object.__setattr__(self, "angles", dict(self.angles))  # a copy that the caller cannot change
        elif self.angles is not None:
            _check_pair(self.angles)

    def of(self, servo_id: int) -> tuple[float, float] | None:
        """Return the lowest and highest angle of a servo, None if it has no limits."""
        return self.angles.get(servo_id) if isinstance(self.angles, Mapping) else self.angles

    def too_far(self, servo_id: int, degrees: float) -> bool:
        """Return whether an angle is outside the servo's limits."""
        allowed = self.of(servo_id)
        return allowed is not None and not allowed[0] <= degrees <= allowed[1]

    def too_fast(self, degrees: float, seconds: float) -> bool:
        """Return whether turning by `degrees` in `seconds` exceeds the speed cap."""
        if self.speed_cap is None:
            return False
        asked = degrees_per_second(degrees, seconds)
        return asked > self.speed_cap and not math.isclose(asked, self.speed_cap)  # 29 degrees in 0.29 s are 100/s


def degrees_per_second(degrees: float, seconds: float) -> float:
    """Return the speed of a turn by `degrees`: 0 if there is nothing to turn, infinite if there is no time."""
    if not degrees:
        return 0.0
    return abs(degrees) / seconds if seconds > 0 else math.inf


def _check_cap(cap: object) -> None:
    if not is_number(cap):
        raise TypeError(f"speed_cap must be a number of degrees per second, not {quote(cap)}")
    if not cap > 0:
        raise EncodeError(f"speed_cap must be above 0 degrees per second, not {quote(cap)}")


def _check_pair(pair: object) -> None:
    if not (isinstance(pair, (tuple, list)) and len(pair) == 2 and all(map(is_number, pair))):
        raise TypeError(f"angle_limits must be pairs of degrees, (lowest, highest), not {quote(pair)}")
    if not pair[0] <= pair[1]:
        raise EncodeError(f"angle_limits: no angle is within {quote(pair[0])}..{quote(pair[1])}")


def _check_servo_id(where: str, servo_id: object) -> None:
    if isinstance(servo_id, bool) or not isinstance(servo_id, int) or not 0 <= servo_id <= 0xFE:
        raise EncodeError(f"{where}: servo id {quote(servo_id)} is outside 0..254")


def checked_targets(targets: Mapping[int, float]) -> dict[int, float]:
    """Return a copy of `targets`. Raise TypeError or EncodeError if they are not angles by servo id, or empty."""
    if not isinstance(targets, Mapping):
        raise TypeError(f"move: targets must map servo ids to angles, such as {{1: 90}}, not {quote(targets)}")
    if not targets:
        raise EncodeError("move: no targets were given")
    for servo_id in targets:
        _check_servo_id("move", servo_id)
    return dict(targets)


def wire_angles(targets: Mapping[int, float], unit_of: Callable[[int], AngleUnit | None]) -> dict[int, int]:
    """Return the numbers to send for `targets`. Raise EncodeError for an angle in a wrong unit."""
    return {servo_id: wire_angle(value, unit_of(servo_id), servo_id) for servo_id, value in targets.items()}


def check_limits(
    angles: Mapping[int, int],
    unit_of: Callable[[int], AngleUnit | None],
    limits: MotionLimits,
    speed: float | None = None,
) -> None:
    """Raise EncodeError for an angle outside its limits, or if limits or `speed` cannot apply to the servo's unit."""
    for servo_id, angle in angles.items():
        allowed = limits.of(servo_id)
        in_degrees = allowed is not None or limits.speed_cap is not None or speed is not None
        if in_degrees and unit_of(servo_id) != "degree":
            raise EncodeError(
                f"servo {servo_id}: limits and speeds are in degrees, and this servo is not set to degrees"
            )
        if allowed and limits.too_far(servo_id, angle):
            limit = f"{quote(allowed[0])}..{quote(allowed[1])}"
            raise EncodeError(f"servo {servo_id}: {quote(int(angle))} degrees is outside its limits {limit}")


def intervals_for(
    angles: Mapping[int, int],
    here: Mapping[int, int],
    limits: MotionLimits,
    *,
    duration: float | None,
    speed: float | None,
) -> dict[int, int]:
    """Return each servo's time in units of 10 ms, rounded up. Raise EncodeError for an impossible time or speed.

    `here` holds the present angles; it may be empty if neither `speed` nor a speed cap is given.
    """
    intervals = {}
    for servo_id, angle in angles.items():
        distance = abs(angle - here[servo_id]) if here else 0
        seconds = seconds_for(distance, duration, speed)
        # Rounded, so that 0.07 s stays 7 units although 0.07 * 100 is a little more; infinite at the lowest speeds.
        hundredths = round(seconds * _INTERVALS_PER_SECOND, 6)
        if hundredths > _LONGEST:
            raise EncodeError(f"servo {servo_id}: {seconds:g} s is outside 0.01..{_LONGEST / _INTERVALS_PER_SECOND} s")
        interval = max(1, math.ceil(hundredths))
        sent = interval / _INTERVALS_PER_SECOND
        if limits.too_fast(distance, sent):
            asked = degrees_per_second(distance, sent)
            raise EncodeError(
                f"servo {servo_id}: {distance} degrees in {sent} s is {asked:.0f} degrees/s; "
                f"its cap is {limits.speed_cap:g}"
            )
        intervals[servo_id] = interval
    return intervals


def seconds_for(distance: int, duration: float | None, speed: float | None) -> float:
    """Return the seconds for turning by `distance` degrees. Raise EncodeError for an impossible duration or speed."""
    if (duration is None) == (speed is None):
        raise EncodeError("move: give either duration or speed")
    if speed is not None:
        if not (is_number(speed) and 0 < speed < math.inf):
            raise EncodeError(f"move: speed must be finite and above 0 degrees per second, not {quote(speed)}")
        return distance / speed
    if not (is_number(duration) and 0.01 <= duration <= _LONGEST / _INTERVALS_PER_SECOND):
        raise EncodeError(f"move: duration {quote(duration)} is outside 0.01..{_LONGEST / _INTERVALS_PER_SECOND} s")
    return duration
