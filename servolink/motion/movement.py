"""Movement: targets, checked against the limits, and the time of each servo."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping

from servolink.errors import EncodeError, MotionRefused, Reason
from servolink.escaping import quote
from servolink.motion.angles import AngleUnit
from servolink.motion.limits import BACK_STEP, MotionLimits, degrees_per_second
from servolink.numeric import as_number, checked_servo_id, is_number

INTERVAL_UNIT = 0.01
"""Seconds that an interval of 1 stands for (3.2.5), unless a board was found to count otherwise."""
Speed = float | Mapping[int, float]
"""Degrees per second: one for all servos, or by servo id."""
_LONGEST = 0x7FFF


def checked_targets(targets: Mapping[int, float]) -> dict[int, float]:
    """Return a copy of `targets`. Raise TypeError or EncodeError if they are not angles by servo id, or empty."""
    if not isinstance(targets, Mapping):
        raise TypeError(f"move: targets must map servo ids to angles, such as {{1: 90}}, not {quote(targets)}")
    if not targets:
        raise EncodeError("move: no targets were given")
    return {checked_servo_id("move", servo_id): as_number(angle) for servo_id, angle in targets.items()}


def check_limits(
    angles: Mapping[int, int],
    unit_of: Callable[[int], AngleUnit | None],
    limits: MotionLimits,
    speed: Speed | None = None,
    *,
    pose: Mapping[int, int] | None = None,
) -> None:
    """Raise MotionRefused for an angle outside its limits, or if limits or `speed` cannot apply to the servo's unit.

    `pose` holds the present angles, from where a servo outside its limits may turn toward them in small steps; empty
    where no target is outside.
    """
    if speed is None and not limits:
        return
    for servo_id, angle in angles.items():
        if (speed is not None or limits.apply_to(servo_id)) and unit_of(servo_id) != "degree":
            raise MotionRefused(
                f"servo {servo_id}: limits and speeds are in degrees, and this servo is not set to degrees",
                reason=Reason.ANGLE_UNIT,
            )
        if exceeded := limits.exceeded_angles(servo_id, angle):
            text = f"servo {servo_id}: {quote(int(angle))} degrees is outside its limits {exceeded}"
            if not pose or not limits.exceeded_angles(servo_id, pose[servo_id]):
                raise MotionRefused(text, reason=Reason.LIMIT)
            if not limits.is_way_back(servo_id, pose[servo_id], angle):
                way = f"toward them by {BACK_STEP} degrees at a time"
                text += f"; from {quote(int(pose[servo_id]))} it may turn within them, or {way}"
                raise MotionRefused(text, reason=Reason.LIMIT)


def intervals_for(
    angles: Mapping[int, int],
    start: Mapping[int, int],
    limits: MotionLimits,
    *,
    duration: float | None,
    speed: Speed | None,
    unit: float = INTERVAL_UNIT,
    soft: Collection[int] = (),
) -> dict[int, int]:
    """Return each servo's time in units of `unit` seconds, rounded up.

    `start` holds the present angles, empty without `speed`, a speed cap and `soft`. `soft` is the set of servos with a
    first movement from an unknown pose: to keep the soft start of each, the whole movement takes longer if necessary.
    Raise EncodeError for an impossible time, MotionRefused for a speed above the cap.
    """
    distances = {servo_id: abs(angle - start[servo_id]) if start else 0 for servo_id, angle in angles.items()}
    times = {
        servo_id: max(seconds_for(distance, duration, _speed_of(servo_id, speed), unit), unit)
        for servo_id, distance in distances.items()
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
            average = degrees_per_second(distance, sent)
            raise MotionRefused(
                f"servo {servo_id}: {distance} degrees in {sent:g} s is {average:.0f} degrees/s; its cap is {exceeded}",
                reason=Reason.LIMIT,
            )
    return intervals


def check_pace(duration: float | None, speed: Speed | None, unit: float = INTERVAL_UNIT) -> None:
    """Raise EncodeError for an impossible duration or speed."""
    for one in speed.values() if isinstance(speed, Mapping) else [speed]:
        seconds_for(0, duration, one, unit)


def _speed_of(servo_id: int, speed: Speed | None) -> float | None:
    if not isinstance(speed, Mapping):
        return speed
    if servo_id not in speed:
        raise EncodeError(f"move: there is no speed for servo {servo_id}")
    return speed[servo_id]


def seconds_for(distance: int, duration: float | None, speed: float | None, unit: float = INTERVAL_UNIT) -> float:
    """Return the seconds for turning by `distance` degrees. Raise EncodeError for an impossible duration or speed."""
    if (duration is None) == (speed is None):
        raise EncodeError("move: give either duration or speed")
    duration, speed = as_number(duration), as_number(speed)
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
