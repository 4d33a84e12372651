"""Set-points of a stream: angles kept to limits, and speeds kept to caps by shortening the way. No clock."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from msgspec import Struct

from servolink.errors import EncodeError, MotionRefused, Reason, quote
from servolink.motion.angles import Angle, Degrees
from servolink.motion.limits import MotionLimits
from servolink.motion.movement import INTERVAL_UNIT
from servolink.protocol import Step
from servolink.support import as_number, checked_servo_id, is_number

FRESH = 0.5
"""Seconds for which a reading or the last target sent says where a servo is."""
_LEAD = 0.05  # seconds beyond a period, since a way of few whole degrees would be much slower than its cap


class ServoWay(Struct, frozen=True):
    """Movement of a servo as sent, from where the servo was then."""

    start: float
    target: int
    began: float
    seconds: float

    def at(self, now: float) -> float:
        """Return the angle at `now` of a servo that turns evenly."""
        share = min(max(now - self.began, 0.0) / self.seconds, 1.0) if self.seconds else 1.0
        return self.start + (self.target - self.start) * share


class SetPoints:
    """Limiter of set-points: returns the steps to send in place of refusing an angle or a speed.

    Times are in seconds of any clock that does not jump. A servo with a speed cap turns from the angle that it has
    reached by now on the way to its last target, or from a reading if nothing was sent for 0.5 s. With `soft_start`, a
    servo goes to its first set-point no faster than that.
    """

    def __init__(
        self, limits: MotionLimits, hz: float, interval_unit: float = INTERVAL_UNIT, *, any_angle: bool = False
    ) -> None:
        """Limit up to `hz` set-points a second by `limits`; an interval of 1 stands for `interval_unit` seconds."""
        self.limits = limits
        self.arrived: set[int] = set()
        """Servos that were sent to a set-point without shortening."""
        self.latest: tuple[Step, ...] = ()
        """Steps of the last movement sent."""
        self.any_angle = any_angle
        """Whether servos whose readings cannot be true are moved too."""
        self.motions = -1
        """Motions sent on the connection up to the last set-point; another number means that something else moved."""
        self._period = max(1 / hz, interval_unit)
        self._unit = interval_unit
        self._ways: dict[int, ServoWay] = {}

    def forget(self, motions: int) -> None:
        """Forget where the servos are: something else has moved them, the last of now `motions` motions."""
        self._ways.clear()
        self.motions = motions

    def lacking(self, servo_ids: Collection[int], now: float) -> set[int]:
        """Return the servos that must be read before their set-points can be shortened."""
        return {
            servo_id
            for servo_id in servo_ids
            if self._speed_of(servo_id) is not None
            and (servo_id not in self._ways or now - self._ways[servo_id].began > FRESH)
        }

    def read(self, pose: Mapping[int, int], now: float) -> None:
        """Start from the angles of a reading made at `now`."""
        self._ways |= {servo_id: ServoWay(float(angle), int(angle), now, 0.0) for servo_id, angle in pose.items()}

    def steps(self, targets: Mapping[int, float], now: float) -> tuple[Step, ...]:
        """Return a movement toward `targets` within the limits, to be sent at `now` or later.

        Raise MotionRefused if limits exclude every whole angle of a servo.
        """
        return tuple(self._step(servo_id, self._within(servo_id, target), now) for servo_id, target in targets.items())

    def sent(self, targets: Mapping[int, float], steps: tuple[Step, ...], now: float) -> None:
        """Count `steps`, as returned for `targets`, as sent at `now`."""
        self.latest = steps
        self.motions += 1
        for step in steps:
            before = self._ways.get(step.servo_id)
            start = step.degree if before is None else before.at(now)
            self._ways[step.servo_id] = ServoWay(start, step.degree, now, step.interval * self._unit)
            if step.degree == self._within(step.servo_id, targets[step.servo_id]):
                self.arrived.add(step.servo_id)

    def _within(self, servo_id: int, target: float) -> int:
        """Return the whole angle next to `target` that the limits allow."""
        low, high = self.limits.of(servo_id) or (-math.inf, math.inf)
        whole = round(min(max(target, low), high)) if low <= high else 0
        whole += (whole < low) - (whole > high)
        if not low <= whole <= high:
            text = f"servo {servo_id}: its limits {low:g}..{high:g} allow no whole angle"
            raise MotionRefused(text, reason=Reason.LIMIT)
        return whole

    def _step(self, servo_id: int, target: int, now: float) -> Step:
        speed, seconds = self._speed_of(servo_id), self._period
        if speed is not None:
            way = self._ways[servo_id]
            here, reach = way.at(now), speed * (self._period + _LEAD)
            if target - here > reach:
                target = max(math.floor(here + reach), math.floor(here) + 1)
            elif here - target > reach:
                target = min(math.ceil(here - reach), math.ceil(here) - 1)
            # When this is sent, the servo is between here and the last target.
            farthest = max(abs(target - here), abs(target - way.target))
            seconds = max(seconds, farthest / speed)
        return Step(servo_id, target, max(1, math.ceil(round(seconds / self._unit, 6))))

    def _speed_of(self, servo_id: int) -> float | None:
        soft = None if servo_id in self.arrived else self.limits.soft_speed_of(servo_id)
        return self.limits.cap_of(servo_id) if soft is None else soft


def checked_set_points(targets: Mapping[int, float]) -> dict[int, float]:
    """Return a copy of `targets`. Raise EncodeError for NaN, infinity and raw angles."""
    if not targets:
        raise EncodeError("stream: no set-points were given")
    angles = {checked_servo_id("stream", servo_id): as_number(angle) for servo_id, angle in targets.items()}
    for servo_id, angle in angles.items():
        is_degree = is_number(angle) and (not isinstance(angle, Angle) or isinstance(angle, Degrees))
        if not is_degree or not abs(angle) < math.inf:
            raise EncodeError(f"servo {servo_id}: a set-point must be a finite angle in degrees, not {quote(angle)}")
    return {servo_id: int(angle) if isinstance(angle, Angle) else angle for servo_id, angle in angles.items()}
