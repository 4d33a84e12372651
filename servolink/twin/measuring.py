"""Measuring: speed, lag and strength of a servo, as they fit the readings of its movements best.

The movements are simulated on the body, held in the air, with other and other values of the servo. Readings are whole
degrees, and known to be late or early by some milliseconds; angles are compared, and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import date
from typing import Any, Final, NamedTuple

from msgspec.structs import replace as with_fields

from servolink.errors import TwinError
from servolink.project import Figure
from servolink.twin.body import Body, Drive
from servolink.twin.simulation import STEP, Physics

TURN: Final = 30
"""Degrees of a movement to one side."""
QUICK: Final = 0.02
"""Seconds of a movement that no servo can follow, which shows how fast it is."""
SLOW: Final = 0.5
"""Seconds of a movement that a servo can follow, which shows how far it lags."""
WIDEST: Final = 0.1
"""Widest range that is kept, as a share of the value to either side."""

_RANGE = 2.5  # standard errors to either side: 99 of 100 ranges hold the value
_ROUNDING, _LATE = 0.3, 0.003  # standard errors of a reading, in degrees and in seconds
_OFFSET, _TORQUE = 0.5, 1.0  # of the zero of the servo in degrees, and of the logarithm of the torque
_MISSED = 10.0  # degrees by which a servo may sag
_SETTLING = 0.6  # seconds in which the body comes to rest before a movement
_ROUNDS, _ENOUGH = 25, 1e-3  # of the search, which ends with a smaller gain
_GENTLE, _HARSH = 1e-3, 1e6  # damping of the search, at first and at most
_CHANGE = 0.02  # of a parameter, for a slope
_LONGEST_STEP = 0.5  # of the logarithm of a value
_LEAST, _WHOLLY = 1e-6, 5.0  # knowledge, and range of the logarithm, of a parameter that no reading depends on
_SHARED = 5  # parameters besides the delay of each movement
_MISFIT = 4.0  # variance of the residuals, as a multiple of the expected one, beyond which it is another servo
_NAMES = "speed", "lag", "torque"


class MeasuredServo(NamedTuple):
    """Values of a servo."""

    figure: Figure
    """The figure with all values whose range is narrow."""
    found: dict[str, tuple[float, float, float]]
    """Value, lowest and highest of `speed` (degrees/s), `lag` (degrees) and `torque` (N m)."""
    unknown: dict[str, str]
    """Values that are not kept, with the reason."""


class _ReadMotion(NamedTuple):
    """One movement, and the readings in which the servo turned."""

    pose: Mapping[int, float]
    target: float
    seconds: float
    times: Sequence[float]
    angles: Sequence[float]


class _Linear(NamedTuple):
    """Readings compared with a simulation: standard errors, differences, and their change for each parameter."""

    weights: list[Any]
    errors: Any
    slopes: Any


class ServoMeasuring:
    """Readings of the movements of one servo, and what they say of it."""

    def __init__(self, figure: Figure, servo_id: int) -> None:
        """Begin without readings. Raise TwinError if the servo turns no part, or without MuJoCo."""
        self._figure, self._servo_id = figure, servo_id
        body = Body.of(figure)
        if servo_id not in body.drives:
            raise TwinError(f"figure.joints: servo {servo_id} turns no part of the figure")
        self._body = replace(body, bolted=True, has_floor=False)
        self._physics = Physics(self._body)
        self._motions = list[_ReadMotion]()

    def movement(self, number: int, start: int, low: float, high: float) -> list[tuple[int, float]]:
        """Return target and seconds of each part of a movement there and back: quickly, then slowly.

        Args:
            number: Number of the movement, from 0; the side changes where there is room on both.
            start: Degrees at which the servo is.
            low: Least degrees to which it may turn, besides the limits of the figure.
            high: Most degrees.

        Raises:
            TwinError: There is no room.
        """
        lowest, highest = (math.degrees(one) for one in self._body.drives[self._servo_id][0].limits)
        low, high = max(low, lowest), min(high, highest)
        room = [goal for goal in (start + TURN, start - TURN) if low <= goal <= high]
        if not (room and low <= start <= high):
            raise TwinError(
                f"servo {self._servo_id} is at {start}° and may turn from {low:.0f}° to {high:.0f}°, without room for "
                f"{TURN}°: move it first"
            )
        goal = room[number % len(room)]
        return [(goal, QUICK), (start, QUICK), (goal, SLOW), (start, SLOW)]

    def add(
        self, pose: Mapping[int, float], target: float, seconds: float, readings: Sequence[tuple[float, float]]
    ) -> None:
        """Add a movement that began in a pose, in degrees by servo id.

        `readings` are seconds since it was sent and degrees. Those equal to both neighbours say nothing new.
        Raise TwinError for a servo that has not turned, or has not arrived.
        """
        angles = [angle for _, angle in readings]
        near = zip(angles[:1] + angles[:-1], angles, angles[1:] + angles[-1:], strict=True)
        turned = [one for one, (before, at, after) in zip(readings, near, strict=True) if not before == at == after]
        if not turned:
            raise TwinError(f"servo {self._servo_id} was told to turn, and reports that it has not")
        if abs(angles[-1] - target) > _MISSED:
            raise TwinError(
                f"servo {self._servo_id} has come to {angles[-1]:.0f}° and not to {target:.0f}°: something is in the "
                "way, or it is too weak for what it carries"
            )
        self._motions.append(_ReadMotion(pose, target, seconds, *zip(*turned, strict=True)))

    def result(self, movements: int, on: date) -> MeasuredServo:
        """Return the values that fit the readings, measured with some movements on a day.

        Raise TwinError for readings that no servo of this body could give.
        """
        part, drive = self._body.drives[self._servo_id]
        fit = _Fit(self._physics, self._servo_id, self._motions)
        found, unknown = fit.search(drive), dict[str, str]()
        for name, (value, _, highest) in found.items():
            if highest / value - 1 > WIDEST:
                unknown[name] = f"the range is wider than {WIDEST:.0%} to either side; more movements narrow it"
        if "torque" in unknown:
            unknown["torque"] += ", and so does a limb that is heavy for its servo and points sideways"
        if self._body.basis["weight"] == "assumed":
            unknown["torque"] = "it follows from the weight, which the figure does not say"
        kept = {name: value for name, value in found.items() if name not in unknown}
        joints = tuple(
            joint.with_measured(on=on.isoformat(), movements=movements, **kept) if joint.id == part.name else joint
            for joint in self._figure.joints
        )
        return MeasuredServo(with_fields(self._figure, joints=joints).checked(), found, unknown)


class _Fit:
    """Search for the values of a servo, by the method of Levenberg and Marquardt.

    Parameters are the logarithms of speed, lag and torque, the delay of all movements, the zero of the servo, and how
    much later than the others each movement began.
    """

    def __init__(self, physics: Physics, servo_id: int, motions: Sequence[_ReadMotion]) -> None:
        import numpy as np  # late: MuJoCo brings it

        self._np: Any = np
        self._physics, self._at = physics, physics.servo_ids.index(servo_id)
        self._servo_id = servo_id
        self._motions = motions
        self._usual = 0.0  # logarithm of the torque before
        self._damping = _GENTLE

    def search(self, drive: Drive) -> dict[str, tuple[float, float, float]]:
        """Return value, lowest and highest of each value, found from those of a drive.

        Raise TwinError for readings that no servo could give.
        """
        lag = drive.torque / drive.stiffness
        self._usual = math.log(drive.torque)
        first = [math.log(math.degrees(drive.speed)), math.log(math.degrees(lag)), self._usual]
        values = self._np.array([*first, 0.0, 0.0, *(0.0 for _ in self._motions)])
        courses = self._courses(values)
        for _ in range(_ROUNDS):
            before = self._looked(values, courses)
            better = self._better(values, before)
            if better is None:
                break
            values, courses, gain = better
            if gain < _ENOUGH * (before.errors @ before.errors):
                break
        return self._ranges(values, self._looked(values, courses))

    def _looked(self, values: Any, courses: Sequence[tuple[Any, Any]]) -> _Linear:
        """Return errors and slopes at these values."""
        weights = self._weights(courses)
        errors = self._errors(values, courses, weights)
        return _Linear(weights, errors, self._slopes(values, courses, weights, errors))

    def _better(self, values: Any, now: _Linear) -> tuple[Any, list[tuple[Any, Any]], float] | None:
        """Return better values, their courses, and the gain; None if there are no better ones."""
        np, normal = self._np, now.slopes.T @ now.slopes
        while self._damping < _HARSH:
            damped = normal + self._damping * np.diag(np.diag(normal) + _LEAST)
            step = np.linalg.solve(damped, -now.slopes.T @ now.errors)
            step[: len(_NAMES)] = step[: len(_NAMES)].clip(-_LONGEST_STEP, _LONGEST_STEP)
            courses = self._courses(values + step)
            errors = self._errors(values + step, courses, now.weights)
            gain = float(now.errors @ now.errors - errors @ errors)
            if gain > 0:
                self._damping /= 10
                return values + step, courses, gain
            self._damping *= 10
        return None

    def _ranges(self, values: Any, now: _Linear) -> dict[str, tuple[float, float, float]]:
        misfit = float(now.errors @ now.errors) / (len(now.errors) - len(values))
        if not misfit <= _MISFIT:
            raise TwinError(
                f"the readings of servo {self._servo_id} do not fit a servo that turns this part of the figure: was "
                "something in the way, or is the figure of another robot? nothing was kept"
            )
        normal = now.slopes.T @ now.slopes
        variances = self._np.diag(self._np.linalg.inv(normal + _LEAST * self._np.eye(len(normal))))
        found = {}
        for name, value, variance in zip(_NAMES, values.tolist(), variances.tolist(), strict=False):
            side = min(_RANGE * math.sqrt(variance * max(1.0, misfit)), _WHOLLY)
            low, middle, high = (float(f"{math.exp(one):.4g}") for one in (value - side, value, value + side))
            found[name] = middle, low, high
        return found

    def _courses(self, values: Any) -> list[tuple[Any, Any]]:
        """Return times and angles of each movement, simulated with a servo of these values."""
        speed, lag, torque = (math.exp(value) for value in values[: len(_NAMES)])
        self._physics.set_drive(self._at, Drive(torque, math.radians(speed), torque / math.radians(lag)))
        return [self._course(motion) for motion in self._motions]

    def _course(self, motion: _ReadMotion) -> tuple[Any, Any]:
        physics, start = self._physics, motion.pose[self._servo_id]
        physics.reset(motion.pose)
        physics.advance(round(_SETTLING / STEP))
        angles = [physics.angle(self._at)]
        for number in range(math.ceil(motion.times[-1] / STEP)):
            share = min((number + 0.5) * STEP / motion.seconds, 1.0)
            physics.data.ctrl[self._at] = math.radians(start + (motion.target - start) * share)
            physics.advance(1)
            angles.append(physics.angle(self._at))
        return self._np.arange(len(angles)) * STEP, self._np.array(angles)

    def _weights(self, courses: Sequence[tuple[Any, Any]]) -> list[Any]:
        """Return the standard error of each reading: a servo that turns quickly is read with a larger one."""
        np = self._np
        slopes = [
            np.interp(one.times, times, np.gradient(angles, STEP)) for one, (times, angles) in self._read(courses)
        ]
        return [np.hypot(_ROUNDING, _LATE * slope) for slope in slopes]

    def _read(self, courses: Sequence[tuple[Any, Any]]) -> Iterator[tuple[_ReadMotion, tuple[Any, Any]]]:
        return zip(self._motions, courses, strict=True)

    def _errors(self, values: Any, courses: Sequence[tuple[Any, Any]], weights: Sequence[Any]) -> Any:
        """Return how far readings, and parameters of which something is known, are off, in standard errors."""
        np = self._np
        delay, zero, delays = values[3], values[4], values[_SHARED:]
        readings = [
            (np.interp(np.array(one.times) - delay - later, *course) + zero - np.array(one.angles)) / weight
            for (one, course), later, weight in zip(self._read(courses), delays, weights, strict=True)
        ]
        return np.concatenate([*readings, delays / _LATE, [zero / _OFFSET, (values[2] - self._usual) / _TORQUE]])

    def _slopes(self, values: Any, courses: Sequence[tuple[Any, Any]], weights: Sequence[Any], errors: Any) -> Any:
        """Return the change of each error for a change of each parameter."""
        columns = []
        for at in range(len(values)):
            is_value = at < len(_NAMES)
            change = _CHANGE if is_value else _CHANGE * _ROUNDING if at == _SHARED - 1 else _CHANGE * _LATE
            moved = values.copy()
            moved[at] += change
            seen = self._courses(moved) if is_value else courses
            columns.append((self._errors(moved, seen, weights) - errors) / change)
        return self._np.stack(columns, axis=1)
