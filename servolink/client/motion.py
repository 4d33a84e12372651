"""Checks and arithmetic of a movement, before a byte of it is sent."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeGuard

from servolink.client.angles import AngleUnit, wire_angle
from servolink.errors import EncodeError

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
        """Raise EncodeError for limits that allow nothing."""
        if self.speed_cap is not None and not self.speed_cap > 0:
            raise EncodeError(f"speed_cap: {self.speed_cap!r} degrees per second is not above 0")
        for low, high in [self.angles] if isinstance(self.angles, tuple) else (self.angles or {}).values():
            if not low <= high:
                raise EncodeError(f"angle_limits: no angle is within {low!r}..{high!r}")

    def of(self, servo_id: int) -> tuple[float, float] | None:
        """Return lowest and highest angle of a servo, None if it has no limits."""
        return self.angles if isinstance(self.angles, tuple) else (self.angles or {}).get(servo_id)


def wire_angles(targets: Mapping[int, float], unit_of: Callable[[int], AngleUnit | None]) -> dict[int, int]:
    """Return the numbers to send for `targets`; EncodeError for a wrong unit or servo id, or for no target at all."""
    if not targets:
        raise EncodeError("move: no targets were given")
    for servo_id in targets:
        if isinstance(servo_id, bool) or not isinstance(servo_id, int) or not 0 <= servo_id <= 0xFE:
            raise EncodeError(f"move: servo id {servo_id!r} is outside 0..254")
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
            limit = f"{allowed[0]:g}..{allowed[1]:g}"
            raise EncodeError(f"servo {servo_id}: {int(angle)} degrees is outside its limits {limit}")


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
        interval = max(1, math.ceil(round(seconds * _INTERVALS_PER_SECOND, 6)))
        if interval > _LONGEST:
            raise EncodeError(
                f"servo {servo_id}: {seconds:.2f} s is outside 0.01..{_LONGEST / _INTERVALS_PER_SECOND} s"
            )
        cap = limits.speed_cap
        if cap is not None and distance > cap * interval / _INTERVALS_PER_SECOND:
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
        if not (_is_number(speed) and 0 < speed < math.inf):
            raise EncodeError(f"move: speed {speed!r} is not above 0 degrees per second")
        return distance / speed
    if not (_is_number(duration) and 0.01 <= duration <= _LONGEST / _INTERVALS_PER_SECOND):
        raise EncodeError(f"move: duration {duration!r} is outside 0.01..{_LONGEST / _INTERVALS_PER_SECOND} s")
    return duration


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
