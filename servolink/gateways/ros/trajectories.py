"""Joints of ROS for servos, and trajectories that others send: names, radians, checks, interpolation. Without ROS."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree as ET

from servolink.errors import MotionRefused, Reason, quote
from servolink.motion import MotionLimits

MOST_POINTS: Final = 10_000  # of a trajectory
MOST_SECONDS: Final = 3600.0  # of a trajectory
INVALID_GOAL, INVALID_JOINTS, OLD_STAMP, PATH_VIOLATED, GOAL_VIOLATED = range(-1, -6, -1)
"""Codes of FollowJointTrajectory; the first also for what was ended by others, for which ROS has none."""

_NEAR_GOAL = math.radians(2)  # radians from the goal, if the sender gives no tolerance
_PATIENCE = 1.0  # seconds from the end of the trajectory, likewise
_OLDEST = 1.0  # seconds since the stamp of a trajectory, at most
_LATEST = 60.0  # seconds from now to the stamp of a trajectory, at most
_NEAR = 5.0  # degrees from the present angle at which a trajectory may begin without time for the way
_MOST = 1e6  # highest number in a point, in any unit
_TURN = 360
_NOT_IN_A_NAME = re.compile(r"[^A-Za-z0-9_]+")


def joints_of(captions: Mapping[int, str], urdf: str = "") -> dict[str, int]:
    """Return the servo of each joint, by name: as in a URDF of `to_urdf`, or else the caption as ROS allows it.

    `captions` are by servo id; servos without one are left out. A servo without a usable caption is `servo_ID`, and of
    equal names all but the first get the id as well.
    """
    found = ET.fromstring(urdf or "<robot/>").iterfind("joint")  # noqa: S314 - of our own making
    servos = ((joint.get("name", ""), joint.find("servolink")) for joint in found)
    joints = {name: int(servo.get("servo", "")) for name, servo in servos if servo is not None}
    joints = {name: servo_id for name, servo_id in joints.items() if servo_id in captions}
    for servo_id in [each for each in captions if each not in joints.values()]:
        name = _NOT_IN_A_NAME.sub("_", captions[servo_id]).strip("_") or "servo"
        name = f"_{name}" if name[0].isdigit() else name
        while name == "servo" or name in joints:
            name = f"{name}_{servo_id}"
        joints[name] = servo_id
    return joints


class TrajectoryRefused(MotionRefused):
    """A trajectory was refused, or was ended for a tolerance; `code` is the `error_code` of FollowJointTrajectory."""

    def __init__(self, text: str, code: int = INVALID_GOAL) -> None:
        super().__init__(text, reason=Reason.LIMIT)
        self.code = code


class Trajectory(NamedTuple):
    """Checked trajectory of servos."""

    servo_ids: tuple[int, ...]
    seconds: tuple[float, ...]
    """Time of each point from the begin, increasing."""
    poses: tuple[tuple[float, ...], ...]
    """Angles at each point in degrees, in the order of `servo_ids`."""

    def at(self, seconds: float) -> dict[int, float]:
        """Return the angles at a time, on the straight way between two points; the first or last outside of all."""
        after = bisect_right(self.seconds, seconds)
        if after in (0, len(self.seconds)):
            return dict(zip(self.servo_ids, self.poses[after and -1], strict=True))
        before, since = self.poses[after - 1], self.seconds[after - 1]
        share = (seconds - since) / (self.seconds[after] - since)
        pairs = zip(before, self.poses[after], strict=True)
        return dict(zip(self.servo_ids, (one + (other - one) * share for one, other in pairs), strict=True))

    def beginning_at(self, pose: Mapping[int, float], limits: MotionLimits) -> Trajectory:
        """Return the trajectory with the way from the present angles. Raise MotionRefused if a servo is too fast."""
        here = tuple(float(pose[servo_id]) for servo_id in self.servo_ids)
        for servo_id, one, first in zip(self.servo_ids, here, self.poses[0], strict=True):
            way = max(abs(first - one) - _NEAR, 0.0)
            if cap := limits.exceeded_cap(servo_id, way, self.seconds[0]):
                text = f"begins {abs(first - one):.0f} degrees from servo {servo_id}, {self.seconds[0]:g} s after now"
                raise _refused(f"{text}: faster than {cap} degrees per second")
        if not self.seconds[0]:
            return self
        return Trajectory(self.servo_ids, (0.0, *self.seconds), (here, *self.poses))


class RosGoal:
    """Goal of FollowJointTrajectory, its tolerances and its result; without `message`, a trajectory of the topic."""

    def __init__(self, message: Any = None, *to: Callable[..., None]) -> None:
        """Give code and text to the first of `to`, and ten times a second angles and errors to the second."""
        self.message, self._to, self._shown = message, to, 0.0

    def settle(self, text: str, code: int = INVALID_GOAL) -> None:
        """Give the result to the sender, unless it has one."""
        for done in self._to[:1]:
            self._to = ()
            done(code, text)

    def check(self) -> None:
        """Read the tolerances. Raise TrajectoryRefused for what a robot of servos does not have or report."""
        goal, names = self.message, self.message.trajectory.joint_names
        patience = goal.goal_time_tolerance.sec + goal.goal_time_tolerance.nanosec * 1e-9
        several = goal.multi_dof_trajectory.points or goal.component_path_tolerance or goal.component_goal_tolerance
        if several or not goal.trajectory.points or not 0 <= patience <= MOST_SECONDS:
            raise _refused(f"has no points, other joints, or a goal_time_tolerance outside 0..{MOST_SECONDS:g} s")
        self._patience = patience or _PATIENCE
        self._path = _tolerances(goal.path_tolerance, names, math.inf)
        self._end = _tolerances(goal.goal_tolerance, names, _NEAR_GOAL)

    def see(self, trajectory: Trajectory, now: float, at: float, angles: Mapping[str, float]) -> bool:
        """Return whether angles, read at `at` since the begin, are the goal. Raise TrajectoryRefused if far off."""
        late, ended = now > trajectory.seconds[-1] + self._patience, at >= trajectory.seconds[-1]
        pose = trajectory.at(math.inf if late else at)
        wanted = dict(zip(self._path, map(math.radians, pose.values()), strict=True))
        off = {name: angle - angles[name] for name, angle in wanted.items() if name in angles}
        if at - self._shown >= 0.1:
            self._shown = at
            for show in self._to[1:]:
                show(wanted, off)
        allowed, code = (self._end, GOAL_VIOLATED) if late or ended else (self._path, PATH_VIOLATED)
        far = [name for name, most in allowed.items() if abs(off.get(name, math.inf)) > most]
        if far and (late or not ended):
            most, what = math.degrees(allowed[far[0]]), "its goal, too late" if late else "the trajectory"
            text = f"{quote(far[0])} is {abs(math.degrees(off.get(far[0], math.inf))):.1f} degrees from {what}"
            raise TrajectoryRefused(f"the motion was ended, as {text}; {most:.1f} are allowed", code)
        return late or (ended and not far)


def read_trajectory(message: Any, joints: Mapping[str, int], limits: MotionLimits) -> Trajectory | None:
    """Return the trajectory in a `trajectory_msgs/JointTrajectory`, or an object with its fields; None for no points.

    Velocities and accelerations are only checked: servos go straight from point to point.

    Raises:
        MotionRefused: A joint is unknown or named twice, a length is wrong, a number is not finite, a time is not later
            than the one before, or an angle or a speed is beyond a limit.
    """
    points = message.points
    if not points:
        return None
    if len(points) > MOST_POINTS:
        raise _refused(f"has {len(points)} points; at most {MOST_POINTS} are allowed")
    servos = _named(message.joint_names, joints)
    seconds: list[float] = []
    poses: list[tuple[float, ...]] = []
    for number, point in enumerate(points, 1):
        time = point.time_from_start.sec + point.time_from_start.nanosec * 1e-9
        if not 0 <= time <= MOST_SECONDS:
            raise _refused(f"point {number} is at {time:g} s; times must be within 0..{MOST_SECONDS:g} s")
        if seconds and time <= seconds[-1]:
            raise _refused(f"point {number} is at {time:g} s, not later than point {number - 1} at {seconds[-1]:g} s")
        seconds.append(float(time))
        poses.append(_pose_of(point, number, servos))
    trajectory = Trajectory(tuple(servos), tuple(seconds), tuple(poses))
    _check_limits(trajectory, tuple(message.joint_names), limits)
    return trajectory


def seconds_until(stamp: float, now: float) -> float:
    """Return the seconds until a trajectory with a stamp in its header begins; 0 means now.

    Raise MotionRefused for a stamp that is old, as of a recording, or far in the future.
    """
    if not stamp:
        return 0.0
    if not -_OLDEST <= stamp - now <= _LATEST:
        raise _refused(f"has the stamp {stamp:.1f}; now is {now:.1f}: use 0, or the next {_LATEST:g} s", OLD_STAMP)
    return max(stamp - now, 0.0)


def _named(names: Sequence[str], joints: Mapping[str, int]) -> list[int]:
    """Return the servos of a trajectory."""
    there = quote(", ".join(joints))
    if not names or len(names) > len(joints):
        raise _refused(f"names {len(names)} joints; this robot has {len(joints)}: {there}", INVALID_JOINTS)
    for number, name in enumerate(names):
        if name not in joints or name in names[:number]:
            again = " twice" if name in joints else ""
            raise _refused(f"names the joint {quote(name)}{again}; this robot has {there}", INVALID_JOINTS)
    return [joints[name] for name in names]


def _pose_of(point: Any, number: int, servos: Sequence[int]) -> tuple[float, ...]:
    """Return the angles of the servos at a point, in degrees."""
    for what in ("positions", "velocities", "accelerations", "effort"):
        values: Sequence[float] = getattr(point, what)
        if len(values) != len(servos) and (what == "positions" or len(values)):
            raise _refused(f"point {number} has {len(values)} {what} for {len(servos)} joints")
        if not all(abs(value) <= _MOST for value in values):
            raise _refused(f"point {number} has {what} beyond {_MOST:g}")
    return tuple(map(math.degrees, point.positions))


def _check_limits(trajectory: Trajectory, names: Sequence[str], limits: MotionLimits) -> None:
    """Raise MotionRefused for an angle or a speed beyond a limit."""
    for place, servo_id in enumerate(trajectory.servo_ids):
        before, since = 0.0, -1.0
        for number, (seconds, pose) in enumerate(zip(trajectory.seconds, trajectory.poses, strict=True), 1):
            angle = pose[place]
            what = f"point {number} of {quote(names[place])}"
            if allowed := limits.exceeded_angles(servo_id, round(angle)):
                raise _refused(f"{what}: {angle:.1f} degrees is outside {allowed} of servo {servo_id}")
            if abs(angle) > _TURN and limits.of(servo_id) is None:
                raise _refused(f"{what}: {angle:.1f} degrees is beyond a whole turn, and there are no limits")
            if since >= 0 and (cap := limits.exceeded_cap(servo_id, angle - before, seconds - since)):
                speed = abs(angle - before) / (seconds - since)
                raise _refused(f"{what}: {speed:.0f} degrees per second is faster than {cap}")
            before, since = angle, seconds


def _tolerances(rows: Sequence[Any], names: Sequence[str], usual: float) -> dict[str, float]:
    """Return the tolerance of each joint in radians: that of its row, `usual` for 0, infinite for -1."""
    found = dict.fromkeys(names, usual)
    for row in rows:
        if row.name not in found:
            raise _refused(f"has a tolerance for {quote(row.name)}, which it does not move", INVALID_JOINTS)
        if not (0 <= row.position <= _MOST or row.position == -1) or max(row.velocity, row.acceleration) > 0:
            raise _refused(f"has a tolerance of {quote(row.name)} other than radians, 0 or -1; speeds are not reported")
        found[row.name] = math.inf if row.position < 0 else row.position or usual
    return found


def _refused(text: str, code: int = INVALID_GOAL) -> TrajectoryRefused:
    return TrajectoryRefused(f"the trajectory {text}; nothing was moved", code)
