"""Movements, planned without a board or a clock: targets, units, limits and the present pose become a packet.

A sender asks the board for what the plan depends on, and plans again if that changes before the sending.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import TypeAlias

from msgspec import Struct

from servolink.errors import EncodeError, MotionRefused, NotFound, Reason, RequestRefused, quote
from servolink.motion.angles import AngleUnit, in_unit, wire_angles
from servolink.motion.limits import BACK_STEP, MotionLimits, degrees_per_second
from servolink.protocol import ExecuteActionRequest, QueryServoListRequest, Step
from servolink.support import as_number, checked_servo_id, is_number

INTERVAL_UNIT = 0.01
"""Seconds that an interval of 1 stands for (3.2.5), unless a board was found to count otherwise."""
Speed = float | Mapping[int, float]
"""Degrees per second: one for all servos, or by servo id."""
UnitOf: TypeAlias = Callable[[int], AngleUnit | None]
"""Returns the unit of a servo, None if it is unknown."""
_LONGEST = 0x7FFF
_TURN = 360  # degrees


class Movement(Struct, frozen=True):
    """Movement that a program asks for, in `duration` seconds or at `speed`."""

    targets: Mapping[int, float]
    """Angles by servo id; plain numbers are degrees."""
    duration: float | None = None
    speed: Speed | None = None
    any_angle: bool = False
    """Whether angles beyond a whole turn are allowed for servos without angle limits."""


class MotionPlan(Struct, frozen=True):
    """Movement ready to be sent."""

    packet: ExecuteActionRequest
    goals: dict[int, int]
    """Target of each servo, in the unit of the servo."""
    seconds: float
    """Time from the sending until the last servo arrives."""


class MotionPlanner(Struct, frozen=True):
    """Planner of movements within limits; an interval of 1 (3.2.5) stands for `interval_unit` seconds.

    In all methods, `unit_of` returns the unit of a servo, `pose` holds the present angles by servo id, empty where
    `needs_pose` says that they do not matter, and `first` the servos whose movement is the first from an unknown pose.
    """

    limits: MotionLimits
    interval_unit: float = INTERVAL_UNIT

    def check(self, movement: Movement, unit_of: UnitOf) -> None:
        """Raise the errors of a movement that no pose allows.

        Raises:
            EncodeError: An angle is in another unit than its servo, or does not fit the protocol.
            MotionRefused: A limit excludes the movement.
        """
        angles = wire_angles(movement.targets, unit_of)
        self.check_turns(angles, unit_of, any_angle=movement.any_angle)
        if not self.are_outside(movement.targets):
            check_limits(angles, unit_of, self.limits, movement.speed, pose={})

    def plan(self, movement: Movement, unit_of: UnitOf, pose: Mapping[int, int], first: Collection[int]) -> MotionPlan:
        """Return the plan of a movement. Raise as `check`, and MotionRefused for a speed above a cap."""
        goals = self.goals(movement.targets, unit_of)
        check_limits(goals, unit_of, self.limits, movement.speed, pose=pose)
        intervals = intervals_for(
            goals,
            pose,
            self.limits,
            duration=movement.duration,
            speed=movement.speed,
            unit=self.interval_unit,
            soft=first,
        )
        self.check_turns(goals, unit_of, any_angle=movement.any_angle)
        steps = tuple(Step(servo_id, int(angle), intervals[servo_id]) for servo_id, angle in goals.items())
        return MotionPlan(ExecuteActionRequest(steps), goals, self.seconds_of(steps))

    def goals(self, targets: Mapping[int, float], unit_of: UnitOf) -> dict[int, int]:
        """Return targets as angles in the units of their servos. Raise EncodeError for an angle in another unit."""
        return {
            servo_id: in_unit(angle, unit_of(servo_id)) for servo_id, angle in wire_angles(targets, unit_of).items()
        }

    def check_turns(self, angles: Mapping[int, float], unit_of: UnitOf, *, any_angle: bool) -> None:
        """Raise MotionRefused for an angle beyond a whole turn, unless its servo has limits, or with `any_angle`."""
        for servo_id, angle in () if any_angle else angles.items():
            if abs(angle) > _TURN and unit_of(servo_id) == "degree" and self.limits.of(servo_id) is None:
                raise MotionRefused(
                    f"servo {servo_id}: {quote(int(angle))} degrees is beyond ±{_TURN}, and no limits say that it can "
                    "turn that far; nothing was sent. Add --any-angle (in Python any_angle=True) if it can",
                    reason=Reason.LIMIT,
                )

    def check_steps(
        self, steps: Collection[Step], unit_of: UnitOf, pose: Mapping[int, int], first: Collection[int]
    ) -> None:
        """Raise MotionRefused for a movement with these steps, which cannot be made slower, beyond a limit."""
        check_limits({step.servo_id: step.degree for step in steps}, unit_of, self.limits, pose=pose)
        for step in steps if pose else ():
            self._check_speed(step, abs(step.degree - pose[step.servo_id]), is_first=step.servo_id in first)

    def seconds_of(self, steps: Iterable[Step]) -> float:
        """Return the seconds from the sending of steps until the last servo arrives; 0 without steps."""
        longest = max((step.interval for step in steps), default=0)
        return round(longest * self.interval_unit, 9)  # 0.07 s rather than 0.07000000000000001 s

    def needs_pose(self, movement: Movement, first: Collection[int]) -> bool:
        """Return whether the plan of a movement depends on the present angles."""
        return movement.speed is not None or self.limits_need_pose(movement.targets, first)

    def limits_need_pose(self, targets: Mapping[int, float], first: Collection[int]) -> bool:
        """Return whether the limits of a turn to `targets` depend on the present angles."""
        if not self.limits:
            return False
        has_cap = any(self.limits.cap_of(servo_id) is not None for servo_id in targets)
        return has_cap or bool(first) or self.are_outside(targets)

    def are_outside(self, targets: Mapping[int, float]) -> bool:
        """Return whether a target is outside the angle limits of its servo."""
        return bool(self.limits) and any(
            is_number(angle) and angle == angle // 1 and self.limits.exceeded_angles(servo_id, angle)
            for servo_id, angle in targets.items()
        )

    def _check_speed(self, step: Step, degrees: int, *, is_first: bool) -> None:
        """Raise MotionRefused for too fast a step of `degrees`."""
        seconds = step.interval * self.interval_unit
        exceeded = self.limits.exceeded_cap(step.servo_id, degrees, seconds)
        why = f"its cap is {exceeded}"
        if not exceeded and is_first:
            exceeded = self.limits.exceeded_soft_start(degrees, seconds)
            why = f"from an unknown pose its soft start allows {exceeded}, to which `move` keeps by itself"
        if exceeded:
            speed = degrees_per_second(degrees, seconds)
            raise MotionRefused(
                f"servo {step.servo_id}: {degrees} degrees in {seconds:g} s is {speed:.0f} degrees/s; {why}",
                reason=Reason.LIMIT,
            )


def checked_targets(targets: Mapping[int, float]) -> dict[int, float]:
    """Return a copy of `targets`. Raise TypeError or EncodeError if they are not angles by servo id, or empty."""
    if not isinstance(targets, Mapping):
        raise TypeError(f"move: targets must map servo ids to angles, such as {{1: 90}}, not {quote(targets)}")
    if not targets:
        raise EncodeError("move: no targets were given")
    return {checked_servo_id("move", servo_id): as_number(angle) for servo_id, angle in targets.items()}


def missing_servo(servo_id: int) -> NotFound:
    """Return the error for a movement of a servo that the board does not have."""
    return NotFound(f"the board has no servo {servo_id}; nothing was moved", QueryServoListRequest())


def idle_servos(servo_ids: Sequence[int]) -> RequestRefused:
    """Return the error for a movement of servos that are stopped or released."""
    who = f"servos {', '.join(map(str, servo_ids))} are" if len(servo_ids) > 1 else f"servo {servo_ids[0]} is"
    return RequestRefused(
        f"{who} stopped or released and would ignore the movement; nothing was sent. "
        "Add --start (in Python start=True, or set_servo before) to start and hold first",
        reason=Reason.SERVO_STATE,
    )


def check_limits(
    angles: Mapping[int, int],
    unit_of: UnitOf,
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
