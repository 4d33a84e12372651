"""Joints of ROS for servos, and trajectories that others send: names, radians, checks, interpolation. Without ROS."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree as ET

from servolink.errors import MotionRefused, Reason, quote
from servolink.motion import MotionLimits

MOST_POINTS: Final = 10_000
"""Most points of a trajectory."""
MOST_SECONDS: Final = 3600.0
"""Longest duration of a trajectory."""

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


def wait_for(stamp: float, now: float) -> float:
    """Return the seconds until a trajectory with a stamp in its header begins; 0 means now.

    Raise MotionRefused for a stamp that is old, as of a recording, or far in the future.
    """
    if not stamp:
        return 0.0
    if not -_OLDEST <= stamp - now <= _LATEST:
        text = f"has the stamp {stamp:.1f}, and now is {now:.1f}"
        raise _refused(f"{text}; use 0 for now, or a time within the next {_LATEST:g} s")
    return max(stamp - now, 0.0)


def _named(names: Sequence[str], joints: Mapping[str, int]) -> list[int]:
    """Return the servos of a trajectory."""
    if not names or len(names) > len(joints):
        raise _refused(f"names {len(names)} joints; this robot has {len(joints)}: {quote(', '.join(joints))}")
    for number, name in enumerate(names):
        if name not in joints or name in names[:number]:
            again = " twice" if name in joints else ""
            raise _refused(f"names the joint {quote(name)}{again}; this robot has {quote(', '.join(joints))}")
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


def _refused(text: str) -> MotionRefused:
    return MotionRefused(f"the trajectory {text}; nothing was moved", reason=Reason.LIMIT)
