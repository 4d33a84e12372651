"""Checks and arithmetic of a movement, before a byte of it is sent."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, Self, TypeGuard

from servolink.errors import EncodeError
from servolink.escaping import quote


def is_number(value: object) -> TypeGuard[float]:
    """Tell whether `value` is a number; True and False are none."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def flag(name: str, value: object) -> int:
    """Return 1 for True and 0 for False; EncodeError for what is neither."""
    if not isinstance(value, int) or value not in {0, 1}:
        raise EncodeError(f"{name}: {quote(value)} is neither True nor False")
    return int(value)


AngleUnit = Literal["degree", "adc"]


class Angle(int):
    """A whole number in one unit; it adds to and compares with plain numbers and its own unit only."""

    unit: ClassVar[str] = ""

    def _same_unit(self, other: object) -> None:
        if isinstance(other, Angle) and type(other) is not type(self):
            raise TypeError(f"{self!r} and {other!r} are in different units")

    def _whole(self, other: int) -> int:
        self._same_unit(other)
        if not isinstance(other, int):
            raise TypeError(f"{self!r} is a whole number, and {other!r} is not")
        return int(other)

    def __add__(self, other: int, /) -> Self:
        """Return the sum, in this unit; TypeError for a fraction."""
        return type(self)(int(self) + self._whole(other))

    def __sub__(self, other: int, /) -> Self:
        """Return the difference, in this unit; TypeError for a fraction."""
        return type(self)(int(self) - self._whole(other))

    __radd__ = __add__

    def __rsub__(self, other: int, /) -> Self:
        """Return the difference, in this unit."""
        return -self + other

    def __neg__(self) -> Self:
        """Return the opposite angle."""
        return type(self)(-int(self))

    def __lt__(self, other: int, /) -> bool:
        """Compare; TypeError across units."""
        self._same_unit(other)
        return int(self) < other

    def __le__(self, other: int, /) -> bool:
        """Compare; TypeError across units."""
        self._same_unit(other)
        return int(self) <= other

    def __gt__(self, other: int, /) -> bool:
        """Compare; TypeError across units."""
        self._same_unit(other)
        return int(self) > other

    def __ge__(self, other: int, /) -> bool:
        """Compare; TypeError across units."""
        self._same_unit(other)
        return int(self) >= other

    def __eq__(self, other: object, /) -> bool:
        """Compare; never equal across units."""
        if isinstance(other, Angle) and type(other) is not type(self):
            return False
        return int(self) == other

    def __ne__(self, other: object, /) -> bool:
        """Compare; `int` has an operator of its own, which knows no units."""
        return not self == other

    def __hash__(self) -> int:
        """Hash as the number, to which it is equal."""
        return hash(int(self))

    def __repr__(self) -> str:
        """Show value and unit."""
        return f"{type(self).__name__}({int(self)})"


class Degrees(Angle):
    """An angle in degrees."""

    unit: ClassVar[str] = "degree"

    def __str__(self) -> str:
        """Show as people write it."""
        return f"{int(self)}°"


class Adc(Angle):
    """An angle as the raw reading of a servo's converter."""

    unit: ClassVar[str] = "adc"

    def __str__(self) -> str:
        """Show with its unit, since nobody expects it."""
        return f"{int(self)} ADC"


def in_unit(value: int, unit: AngleUnit | None) -> int:
    """Return a number that the board reported as an angle in `unit`; a plain number if that is unknown."""
    return value if unit is None else {"degree": Degrees, "adc": Adc}[unit](value)


def wire_angle(value: float, unit: AngleUnit | None, servo_id: int) -> int:
    """Return the number to send for `value` to a servo that is set to `unit`; EncodeError if that is another unit."""
    where = f"servo {servo_id}"
    if isinstance(value, Angle):
        if value.unit != unit:
            raise EncodeError(
                f"{where}: {quote(value)} was given, but this servo is set to {unit or 'an unknown unit'}"
            )
    elif unit == "adc":
        raise EncodeError(f"{where}: {quote(value)} was given, but this servo is set to adc; write Adc({quote(value)})")
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value // 1:
        raise EncodeError(f"{where}: {quote(value)} is no whole number of degrees; the protocol has no fractions")
    return int(value)


_INTERVALS_PER_SECOND = 100  # the protocol counts time in units of 10 ms
_LONGEST = 0x7FFF

AngleLimits = Mapping[int, tuple[float, float]] | tuple[float, float]
"""Lowest and highest angle in degrees: for each servo id, or for all."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """What this program allows itself."""

    angles: AngleLimits | None = None
    speed_cap: float | None = None
    """Degrees per second that no servo may exceed."""

    def __post_init__(self) -> None:
        """Raise EncodeError for limits that allow nothing or are for no servo, TypeError for what is no limit."""
        if self.speed_cap is not None:
            _check_cap(self.speed_cap)
        if isinstance(self.angles, Mapping):
            for servo_id, pair in self.angles.items():
                _check_servo_id("angle_limits", servo_id)
                _check_pair(pair)
            object.__setattr__(self, "angles", dict(self.angles))  # which nobody changes later
        elif self.angles is not None:
            _check_pair(self.angles)

    def of(self, servo_id: int) -> tuple[float, float] | None:
        """Return lowest and highest angle of a servo, None if it has no limits."""
        return self.angles.get(servo_id) if isinstance(self.angles, Mapping) else self.angles


def _check_cap(cap: object) -> None:
    if not is_number(cap):
        raise TypeError(f"speed_cap: {quote(cap)} is no number of degrees per second")
    if not cap > 0:
        raise EncodeError(f"speed_cap: {quote(cap)} degrees per second is not above 0")


def _check_pair(pair: object) -> None:
    if not (isinstance(pair, (tuple, list)) and len(pair) == 2 and all(map(is_number, pair))):
        raise TypeError(f"angle_limits: {quote(pair)} is no pair of degrees, (lowest, highest)")
    if not pair[0] <= pair[1]:
        raise EncodeError(f"angle_limits: no angle is within {quote(pair[0])}..{quote(pair[1])}")


def _check_servo_id(where: str, servo_id: object) -> None:
    if isinstance(servo_id, bool) or not isinstance(servo_id, int) or not 0 <= servo_id <= 0xFE:
        raise EncodeError(f"{where}: servo id {quote(servo_id)} is outside 0..254")


def checked_targets(targets: Mapping[int, float]) -> dict[int, float]:
    """Return a copy of `targets`; TypeError or EncodeError if they are none, or for what is no servo id."""
    if not isinstance(targets, Mapping):
        raise TypeError(f"move: {quote(targets)} is no mapping of servo ids to angles")
    if not targets:
        raise EncodeError("move: no targets were given")
    for servo_id in targets:
        _check_servo_id("move", servo_id)
    return dict(targets)


def wire_angles(targets: Mapping[int, float], unit_of: Callable[[int], AngleUnit | None]) -> dict[int, int]:
    """Return the numbers to send for `targets`; EncodeError for an angle in a wrong unit."""
    return {servo_id: wire_angle(value, unit_of(servo_id), servo_id) for servo_id, value in targets.items()}


def check_limits(
    angles: Mapping[int, int],
    unit_of: Callable[[int], AngleUnit | None],
    limits: MotionLimits,
    speed: float | None = None,
) -> None:
    """Raise EncodeError for an angle outside its limits, or in a unit other than that of its limits and `speed`."""
    for servo_id, angle in angles.items():
        allowed = limits.of(servo_id)
        in_degrees = allowed is not None or limits.speed_cap is not None or speed is not None
        if in_degrees and unit_of(servo_id) != "degree":
            raise EncodeError(
                f"servo {servo_id}: limits and speeds are in degrees, and this servo is not set to degrees"
            )
        if allowed and not allowed[0] <= angle <= allowed[1]:
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
    """Return each servo's time in units of 10 ms, rounded up; EncodeError for a time or speed that is not possible."""
    intervals = {}
    for servo_id, angle in angles.items():
        distance = abs(angle - here[servo_id]) if here else 0
        seconds = seconds_for(distance, duration, speed)
        hundredths = round(seconds * _INTERVALS_PER_SECOND, 6)  # infinite at the slowest of speeds
        if hundredths > _LONGEST:
            raise EncodeError(f"servo {servo_id}: {seconds:g} s is outside 0.01..{_LONGEST / _INTERVALS_PER_SECOND} s")
        interval = max(1, math.ceil(hundredths))
        cap = limits.speed_cap
        if cap is not None and distance * _INTERVALS_PER_SECOND > cap * interval:
            asked = distance * _INTERVALS_PER_SECOND / interval
            raise EncodeError(
                f"servo {servo_id}: {distance} degrees in {interval / _INTERVALS_PER_SECOND} s "
                f"is {asked:.0f} degrees/s; its cap is {cap:g}"
            )
        intervals[servo_id] = interval
    return intervals


def seconds_for(distance: int, duration: float | None, speed: float | None) -> float:
    """Return how long a way of so many degrees takes; EncodeError for a duration or speed that is not possible."""
    if (duration is None) == (speed is None):
        raise EncodeError("move: give either duration or speed")
    if speed is not None:
        if not (is_number(speed) and 0 < speed < math.inf):
            raise EncodeError(f"move: speed {quote(speed)} is not finite and above 0 degrees per second")
        return distance / speed
    if not (is_number(duration) and 0.01 <= duration <= _LONGEST / _INTERVALS_PER_SECOND):
        raise EncodeError(f"move: duration {quote(duration)} is outside 0.01..{_LONGEST / _INTERVALS_PER_SECOND} s")
    return duration
