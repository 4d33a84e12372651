"""Limits: how far and how fast each servo may move."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from msgspec import Struct, field
from msgspec.structs import force_setattr, replace

from servolink.errors import EncodeError, quote
from servolink.support import as_number, checked_servo_id, is_number

AngleLimits = Mapping[int, tuple[float, float]] | tuple[float, float]
"""Lowest and highest angle in degrees: by servo id, or one pair for all servos."""
SpeedCap = float | Mapping[int, float]
"""Highest speed in degrees per second: one for all servos, or by servo id."""
BACK_STEP = 10
"""Degrees by which a servo outside its angle limits may turn toward them in one movement."""


class MotionLimits(Struct, frozen=True):
    """Limits of the angles and speeds of servos. Without arguments there are no limits, and the object is false.

    Raise EncodeError for limits that allow nothing or name no servo, TypeError for values of a wrong type.
    """

    angles: AngleLimits | None = None
    speed_cap: float | None = None
    """Highest speed of any servo, in degrees per second."""
    speed_caps: Mapping[int, float] = field(default_factory=dict)
    """Speed caps of single servos, degrees per second by id; `speed_cap` counts too, and the lower cap wins."""
    soft_start: float | None = None
    """Highest speed of a servo's first movement from an unknown pose, in degrees per second."""
    source: str = ""
    """Where the limits come from, named in errors, such as `profile "rex"`."""
    also: tuple[MotionLimits, ...] = ()
    """Further limits, which apply as well (see `tightened`)."""

    def __post_init__(self) -> None:
        """Check the values, and copy the mappings, which the caller could change."""
        if self.speed_cap is not None:
            force_setattr(self, "speed_cap", _checked_speed("speed_cap", self.speed_cap))
        if self.soft_start is not None:
            force_setattr(self, "soft_start", _checked_speed("soft_start", self.soft_start))
        if not isinstance(self.speed_caps, Mapping):
            raise TypeError(f"speed_caps must map servo ids to degrees per second, not {quote(self.speed_caps)}")
        caps = {checked_servo_id("speed_cap", servo_id): cap for servo_id, cap in self.speed_caps.items()}
        caps = {servo_id: _checked_speed(f"speed_cap of servo {servo_id}", cap) for servo_id, cap in caps.items()}
        force_setattr(self, "speed_caps", caps)
        if isinstance(self.angles, Mapping):
            pairs = {checked_servo_id("angle_limits", one): _checked_pair(pair) for one, pair in self.angles.items()}
            force_setattr(self, "angles", pairs)
        elif self.angles is not None:
            force_setattr(self, "angles", _checked_pair(self.angles))

    def __bool__(self) -> bool:
        """Return whether anything is limited."""
        own = self.angles, self.speed_cap, self.speed_caps, self.soft_start
        return any(own) or any(self.also)

    def tightened(self, other: MotionLimits) -> MotionLimits:
        """Return limits that allow only motions allowed by both. The result never allows more than either of them.

        Where they have nothing in common, nothing is allowed.
        """
        return replace(self, also=(*self.also, other))

    def of(self, servo_id: int) -> tuple[float, float] | None:
        """Return the lowest and highest angle of a servo, None if it has no limits.

        The lowest is above the highest if no angle is allowed.
        """
        pairs = [pair for limits in self.parts() if (pair := limits._angles_of(servo_id)) is not None]  # noqa: SLF001 - of its own class
        return (max(low for low, _ in pairs), min(high for _, high in pairs)) if pairs else None

    def cap_of(self, servo_id: int) -> float | None:
        """Return the highest speed of a servo, None if it has no cap."""
        return min((cap for limits in self.parts() for cap in limits._caps_of(servo_id)), default=None)  # noqa: SLF001 - of its own class

    def soft_speed_of(self, servo_id: int) -> float | None:
        """Return the highest speed of a servo's first movement, None without `soft_start`; never above its cap."""
        softest = min((one.soft_start for one in self.parts() if one.soft_start is not None), default=None)
        cap = self.cap_of(servo_id)
        return softest if softest is None or cap is None else min(softest, cap)

    def limit_speed_of(self, servo_id: int) -> bool:
        """Return whether the speed of a servo is limited, so that checking a movement needs the present angle."""
        return self.cap_of(servo_id) is not None or self.soft_speed_of(servo_id) is not None

    def apply_to(self, servo_id: int) -> bool:
        """Return whether anything about a servo is limited."""
        return self.of(servo_id) is not None or self.limit_speed_of(servo_id)

    def exceeded_angles(self, servo_id: int, degrees: float) -> str:
        """Return the limits that exclude an angle, such as `-80..80 (from profile "rex")`; empty if none do."""
        for limits in self.parts():
            pair = limits._angles_of(servo_id)  # noqa: SLF001 - of its own class
            if pair is not None and not pair[0] <= degrees <= pair[1]:
                return f"{_shown(pair[0])}..{_shown(pair[1])}{limits._origin}"  # noqa: SLF001 - of its own class
        return ""

    def is_way_back(self, servo_id: int, present: float, degrees: float) -> bool:
        """Return whether a turn from `present` to `degrees`, both outside the angle limits, leads toward them.

        A turn of more than `BACK_STEP` does not count: it may be too fast for what holds the servo there.
        """
        low, high = self.of(servo_id) or (-math.inf, math.inf)
        if low > high or abs(degrees - present) > BACK_STEP:
            return False
        return high < degrees <= present or present <= degrees < low

    def exceeded_cap(self, servo_id: int, degrees: float, seconds: float) -> str:
        """Return the speed cap exceeded by turning `degrees` in `seconds`, with its source; empty if none."""
        for limits in self.parts():
            for cap in limits._caps_of(servo_id):  # noqa: SLF001 - of its own class
                if _is_above(cap, degrees, seconds):
                    return f"{_shown(cap)}{limits._origin}"  # noqa: SLF001 - of its own class
        return ""

    def exceeded_soft_start(self, degrees: float, seconds: float) -> str:
        """Return the soft start exceeded by turning `degrees` in `seconds`, with its source; empty if none."""
        for limits in self.parts():
            if limits.soft_start is not None and _is_above(limits.soft_start, degrees, seconds):
                return f"{_shown(limits.soft_start)}{limits._origin}"  # noqa: SLF001 - of its own class
        return ""

    def parts(self) -> Iterator[MotionLimits]:
        """Yield all limits that apply, each with its source: these, and those that tighten them."""
        yield self
        for limits in self.also:
            yield from limits.parts()

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
    """Return the limits for such arguments: one speed cap for all servos, or a cap for each servo."""
    if isinstance(speed_cap, Mapping):
        return MotionLimits(angle_limits, None, speed_cap, soft_start, source)
    return MotionLimits(angle_limits, speed_cap, {}, soft_start, source)


def degrees_per_second(degrees: float, seconds: float) -> float:
    """Return the speed of a turn by `degrees`: 0 if there is nothing to turn, infinite if there is no time."""
    if not degrees:
        return 0.0
    return abs(degrees) / seconds if seconds > 0 else math.inf


def _is_above(limit: float, degrees: float, seconds: float) -> bool:
    speed = degrees_per_second(degrees, seconds)
    return speed > limit and not math.isclose(speed, limit)  # 29 degrees in 0.29 s are 100/s


def _shown(limit: float) -> str:
    return f"{limit:g}" if isinstance(limit, float) else quote(limit)


def _checked_speed(name: str, speed: object) -> float:
    speed = as_number(speed)
    if not is_number(speed):
        raise TypeError(f"{name} must be a number of degrees per second, not {quote(speed)}")
    if not speed > 0:
        raise EncodeError(f"{name} must be above 0 degrees per second, not {quote(speed)}")
    return speed


def _checked_pair(pair: object) -> tuple[float, float]:
    numbers = tuple(map(as_number, pair)) if isinstance(pair, (tuple, list)) else ()
    if not (len(numbers) == 2 and all(map(is_number, numbers))):
        raise TypeError(f"angle_limits must be pairs of degrees, (lowest, highest), not {quote(pair)}")
    low, high = numbers
    if not low <= high:
        raise EncodeError(f"angle_limits: no angle is within {quote(low)}..{quote(high)}")
    return low, high
