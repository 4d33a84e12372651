"""Angles, limits and durations: everything that is checked and computed before a movement is sent."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal, Self, TypeGuard

from servolink.errors import EncodeError, MotionRefused
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


INTERVAL_UNIT = 0.01
"""Seconds that an interval of 1 stands for (3.2.5), unless a board was found to count otherwise."""
_LONGEST = 0x7FFF

AngleLimits = Mapping[int, tuple[float, float]] | tuple[float, float]
"""Lowest and highest angle in degrees: by servo id, or one pair for all servos."""
SpeedCap = float | Mapping[int, float]
"""Highest speed in degrees per second: one for all servos, or by servo id."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """How far and how fast servos may move. Without arguments there are no limits, and it is false.

    Raise EncodeError for limits that allow nothing or name no servo, TypeError for values of a wrong type.
    """

    angles: AngleLimits | None = None
    speed_cap: float | None = None
    """Highest speed of any servo, in degrees per second."""
    speed_caps: Mapping[int, float] = field(default_factory=dict)
    """The same for single servos, by id; where both apply, the lower one counts."""
    soft_start: float | None = None
    """Highest speed of a servo's first movement from an unknown pose, in degrees per second."""
    source: str = ""
    """Where the limits come from, named in errors, such as `profile "rex"`."""
    also: tuple[MotionLimits, ...] = ()
    """Further limits, all of which hold as well (see `tightened`)."""

    def __post_init__(self) -> None:
        """Check the values, and copy those that the caller could change."""
        if self.speed_cap is not None:
            _check_speed("speed_cap", self.speed_cap)
        if self.soft_start is not None:
            _check_speed("soft_start", self.soft_start)
        if not isinstance(self.speed_caps, Mapping):
            raise TypeError(f"speed_caps must map servo ids to degrees per second, not {quote(self.speed_caps)}")
        for servo_id, cap in self.speed_caps.items():
            _check_servo_id("speed_cap", servo_id)
            _check_speed(f"speed_cap of servo {servo_id}", cap)
        object.__setattr__(self, "speed_caps", dict(self.speed_caps))
        if isinstance(self.angles, Mapping):
            for servo_id, pair in self.angles.items():
                _check_servo_id("angle_limits", servo_id)
                _check_pair(pair)
            object.__setattr__(self, "angles", dict(self.angles))
        elif self.angles is not None:
            _check_pair(self.angles)

    def __bool__(self) -> bool:
        """Return whether anything is limited."""
        own = self.angles, self.speed_cap, self.speed_caps, self.soft_start
        return any(own) or any(self.also)

    def tightened(self, other: MotionLimits) -> MotionLimits:
        """Return the limits that allow what both allow. The result never allows more than either of them.

        Where they have nothing in common, nothing is allowed.
        """
        return replace(self, also=(*self.also, other))

    def of(self, servo_id: int) -> tuple[float, float] | None:
        """Return the lowest and highest angle of a servo, None if it has no limits.

        The lowest is above the highest if no angle is allowed.
        """
        pairs = [pair for limits in self._each() if (pair := limits._angles_of(servo_id)) is not None]  # noqa: SLF001 - of its own class
        return (max(low for low, _ in pairs), min(high for _, high in pairs)) if pairs else None

    def cap_of(self, servo_id: int) -> float | None:
        """Return the highest speed of a servo, None if it has no cap."""
        return min((cap for limits in self._each() for cap in limits._caps_of(servo_id)), default=None)  # noqa: SLF001 - of its own class

    def soft_speed_of(self, servo_id: int) -> float | None:
        """Return the highest speed of a servo's first movement, None without `soft_start`; never above its cap."""
        softest = min((one.soft_start for one in self._each() if one.soft_start is not None), default=None)
        cap = self.cap_of(servo_id)
        return softest if softest is None or cap is None else min(softest, cap)

    def limit_speed_of(self, servo_id: int) -> bool:
        """Return whether the speed of a servo is limited, so that a movement can be checked only from where it is."""
        return self.cap_of(servo_id) is not None or self.soft_speed_of(servo_id) is not None

    def apply_to(self, servo_id: int) -> bool:
        """Return whether anything about a servo is limited."""
        return self.of(servo_id) is not None or self.limit_speed_of(servo_id)

    def exceeded_angles(self, servo_id: int, degrees: float) -> str:
        """Return the limits that an angle is outside of, such as `-80..80 (from profile "rex")`; empty if none."""
        for limits in self._each():
            pair = limits._angles_of(servo_id)  # noqa: SLF001 - of its own class
            if pair is not None and not pair[0] <= degrees <= pair[1]:
                return f"{_shown(pair[0])}..{_shown(pair[1])}{limits._origin}"  # noqa: SLF001 - of its own class
        return ""

    def exceeded_cap(self, servo_id: int, degrees: float, seconds: float) -> str:
        """Return the speed cap that turning by `degrees` in `seconds` exceeds, with its source; empty if none."""
        for limits in self._each():
            for cap in limits._caps_of(servo_id):  # noqa: SLF001 - of its own class
                if _is_above(cap, degrees, seconds):
                    return f"{_shown(cap)}{limits._origin}"  # noqa: SLF001 - of its own class
        return ""

    def exceeded_soft_start(self, degrees: float, seconds: float) -> str:
        """Return the soft start that turning by `degrees` in `seconds` exceeds, with its source; empty if none."""
        for limits in self._each():
            if limits.soft_start is not None and _is_above(limits.soft_start, degrees, seconds):
                return f"{_shown(limits.soft_start)}{limits._origin}"  # noqa: SLF001 - of its own class
        return ""

    def _each(self) -> Iterator[MotionLimits]:
        yield self
        for limits in self.also:
            yield from limits._each()  # noqa: SLF001 - of its own class

    def _angles_of(self, servo_id: int) -> tuple[float, float] | None:
        return self.angles.get(servo_id) if isinstance(self.angles, Mapping) else self.angles

    def _caps_of(self, servo_id: int) -> Iterator[float]:
        for cap in (self.speed_cap, self.speed_caps.get(servo_id)):
            if cap is not None:
                yield cap

    @property
    def _origin(self) -> str:
        return f" (from {self.source})" if self.source else ""


def motion_limits(
    angle_limits: AngleLimits | None = None,
    speed_cap: SpeedCap | None = None,
    soft_start: float | None = None,
    source: str = "",
) -> MotionLimits:
    """Return the limits for arguments of this form, in which one speed cap or one for each servo is given."""
    if isinstance(speed_cap, Mapping):
        return MotionLimits(angle_limits, None, speed_cap, soft_start, source)
    return MotionLimits(angle_limits, speed_cap, {}, soft_start, source)


def degrees_per_second(degrees: float, seconds: float) -> float:
    """Return the speed of a turn by `degrees`: 0 if there is nothing to turn, infinite if there is no time."""
    if not degrees:
        return 0.0
    return abs(degrees) / seconds if seconds > 0 else math.inf


def _is_above(limit: float, degrees: float, seconds: float) -> bool:
    asked = degrees_per_second(degrees, seconds)
    return asked > limit and not math.isclose(asked, limit)  # 29 degrees in 0.29 s are 100/s


def _shown(limit: float) -> str:
    return f"{limit:g}" if isinstance(limit, float) else quote(limit)


def _check_speed(name: str, speed: object) -> None:
    if not is_number(speed):
        raise TypeError(f"{name} must be a number of degrees per second, not {quote(speed)}")
    if not speed > 0:
        raise EncodeError(f"{name} must be above 0 degrees per second, not {quote(speed)}")


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
    """Raise MotionRefused for an angle outside its limits, or if limits or `speed` cannot apply to the servo's unit."""
    if speed is None and not limits:
        return
    for servo_id, angle in angles.items():
        if (speed is not None or limits.apply_to(servo_id)) and unit_of(servo_id) != "degree":
            raise MotionRefused(
                f"servo {servo_id}: limits and speeds are in degrees, and this servo is not set to degrees"
            )
        if exceeded := limits.exceeded_angles(servo_id, angle):
            raise MotionRefused(f"servo {servo_id}: {quote(int(angle))} degrees is outside its limits {exceeded}")


def intervals_for(
    angles: Mapping[int, int],
    here: Mapping[int, int],
    limits: MotionLimits,
    *,
    duration: float | None,
    speed: float | None,
    unit: float = INTERVAL_UNIT,
    soft: Collection[int] = (),
) -> dict[int, int]:
    """Return each servo's time in units of `unit` seconds, rounded up.

    `here` holds the present angles; it may be empty if neither `speed` nor a speed cap nor `soft` is given. `soft`
    names the servos that make their first movement from an unknown pose: if one of them would exceed its soft start,
    the whole movement takes longer. Raise EncodeError for an impossible time, MotionRefused for a speed above its cap.
    """
    distances = {servo_id: abs(angle - here[servo_id]) if here else 0 for servo_id, angle in angles.items()}
    times = {
        servo_id: max(seconds_for(distance, duration, speed, unit), unit) for servo_id, distance in distances.items()
    }
    slower = 1.0
    for servo_id in soft:
        softest = limits.soft_speed_of(servo_id)
        if softest is not None:
            slower = max(slower, distances[servo_id] / softest / times[servo_id])
    intervals = {}
    for servo_id, distance in distances.items():
        seconds = times[servo_id] * slower
        # Rounded, so that 0.07 s stays 7 units although 0.07 / 0.01 is a little more; infinite at the lowest speeds.
        units = round(seconds / unit, 6)
        if units > _LONGEST:
            raise EncodeError(f"servo {servo_id}: {seconds:g} s is outside {_possible(unit)}")
        intervals[servo_id] = max(1, math.ceil(units))
        sent = intervals[servo_id] * unit
        if exceeded := limits.exceeded_cap(servo_id, distance, sent):
            asked = degrees_per_second(distance, sent)
            raise MotionRefused(
                f"servo {servo_id}: {distance} degrees in {sent:g} s is {asked:.0f} degrees/s; its cap is {exceeded}"
            )
    return intervals


def seconds_for(distance: int, duration: float | None, speed: float | None, unit: float = INTERVAL_UNIT) -> float:
    """Return the seconds for turning by `distance` degrees. Raise EncodeError for an impossible duration or speed."""
    if (duration is None) == (speed is None):
        raise EncodeError("move: give either duration or speed")
    if speed is not None:
        if not (is_number(speed) and 0 < speed < math.inf):
            raise EncodeError(f"move: speed must be finite and above 0 degrees per second, not {quote(speed)}")
        return distance / speed
    if not (is_number(duration) and unit <= duration <= _longest(unit)):
        raise EncodeError(f"move: duration {quote(duration)} is outside {_possible(unit)}")
    return duration


def _longest(unit: float) -> float:
    return round(_LONGEST * unit, 9)


def _possible(unit: float) -> str:
    return f"{unit:g}..{_longest(unit):g} s"
