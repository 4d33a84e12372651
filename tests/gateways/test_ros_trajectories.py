"""Trajectories of ROS without ROS: joints by name, what is refused and why, and angles between points.

Module: servolink.gateways.ros.trajectories.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import MotionRefused
from servolink.gateways.ros.trajectories import MOST_POINTS, Trajectory, joints_of, read_trajectory, wait_for
from servolink.motion import MotionLimits
from servolink.twin import to_urdf
from tests.twin.figures import template

JOINTS = {"hip": 1, "knee": 2}
LIMITS = MotionLimits({1: (-90, 90)}, 100.0)
NAN = math.nan


def point(seconds: float, *degrees: float, **more: Sequence[float]) -> SimpleNamespace:
    """Return a point of a trajectory at angles in degrees."""
    whole = math.floor(seconds)
    time = SimpleNamespace(sec=whole, nanosec=round((seconds - whole) * 1e9))
    lists: dict[str, Sequence[float]] = {"velocities": (), "accelerations": (), "effort": ()}
    return SimpleNamespace(time_from_start=time, positions=list(map(math.radians, degrees)), **(lists | more))


def message(names: Sequence[str], *points: SimpleNamespace, stamp: float = 0.0) -> Any:
    """Return an object with the fields of a `trajectory_msgs/JointTrajectory`."""
    header = SimpleNamespace(stamp=SimpleNamespace(sec=math.floor(stamp), nanosec=0))
    return SimpleNamespace(header=header, joint_names=list(names), points=list(points))


def test_joints_have_valid_and_different_names_and_those_of_the_urdf() -> None:
    captions = {1: "left knee", 2: "left-knee", 3: "", 4: "肘", 5: "3rd", 6: "hip", 7: "hip_6"}
    assert joints_of(captions) == {
        "left_knee": 1,
        "left_knee_2": 2,
        "servo_3": 3,
        "servo_4": 4,
        "_3rd": 5,
        "hip": 6,
        "hip_6": 7,
    }
    figure = template("humanoid-16")
    turned = sorted(joint.servo for joint in figure.joints if joint.servo)
    urdf = to_urdf(figure, {turned[0]: "first"})
    joints = joints_of(dict.fromkeys([*turned, 99], "same"), urdf)
    assert joints["first"] == turned[0]
    assert joints["same"] == 99
    assert sorted(joints.values()) == [*turned, 99]
    assert all(f'name="{name}"' in urdf for name, servo_id in joints.items() if servo_id != 99)


@given(st.dictionaries(st.integers(0, 254), st.text(max_size=8), max_size=8))
def test_any_captions_give_each_servo_one_valid_name(captions: dict[int, str]) -> None:
    joints = joints_of(captions)
    assert sorted(joints.values()) == sorted(captions)
    assert all(name.isascii() and name.isidentifier() for name in joints)


def test_angles_between_points_are_on_the_straight_way() -> None:
    found = read_trajectory(message(["knee", "hip"], point(1, 10, 20), point(2.5, 40, -10)), JOINTS, LIMITS)
    assert found is not None
    way = found.beginning_at({1: 0, 2: 10}, LIMITS)
    assert way.servo_ids == (2, 1)
    for seconds, knee, hip in (
        (-1, 10, 0),
        (0, 10, 0),
        (0.5, 10, 10),
        (1, 10, 20),
        (1.75, 25, 5),
        (2.5, 40, -10),
        (9, 40, -10),
    ):
        assert way.at(seconds) == pytest.approx({2: knee, 1: hip})


@given(st.lists(st.floats(-180, 180), min_size=1, max_size=6), st.floats(0, 7))
def test_an_angle_lies_between_its_neighbours(angles: list[float], seconds: float) -> None:
    way = Trajectory((1,), tuple(map(float, range(len(angles)))), tuple((angle,) for angle in angles))
    place = min(math.floor(seconds), len(angles) - 1)
    neighbours = angles[place : place + 2]
    assert min(neighbours) - 1e-9 <= way.at(seconds)[1] <= max(neighbours) + 1e-9


@pytest.mark.parametrize(
    ("names", "points", "why"),
    [
        (["hip", "tail"], [point(1, 0, 0)], "names the joint 'tail'; this robot has 'hip, knee'"),
        (["hip", "\x1b[2J"], [point(1, 0, 0)], r"names the joint '\x1b[2J'"),
        (["hip", "hip"], [point(1, 0, 0)], "names the joint 'hip' twice"),
        ([], [point(1)], "names 0 joints"),
        (["hip"] * 3, [point(1, 0, 0, 0)], "names 3 joints; this robot has 2"),
        (["hip"], [point(1, 0), point(2, 0, 0)], "point 2 has 2 positions for 1 joints"),
        (["hip"], [point(1)], "point 1 has 0 positions for 1 joints"),
        (["hip"], [point(1, 0, velocities=[0, 0])], "point 1 has 2 velocities for 1 joints"),
        (["hip"], [point(1, NAN)], "point 1 has positions beyond 1e+06"),
        (["hip"], [point(1, math.inf)], "point 1 has positions beyond 1e+06"),
        (["hip"], [point(1, 1e300)], "point 1 has positions beyond 1e+06"),
        (["hip"], [point(1, 0, accelerations=[NAN])], "point 1 has accelerations beyond 1e+06"),
        (["hip"], [point(-1, 0)], "point 1 is at -1 s"),
        (["hip"], [point(3601, 0)], "times must be within 0..3600 s"),
        (["hip"], [point(1, 0), point(1, 0)], "point 2 is at 1 s, not later than point 1 at 1 s"),
        (["hip"], [point(2, 0), point(1, 0)], "point 2 is at 1 s, not later"),
        (["hip"], [point(1, 0)] * (MOST_POINTS + 1), f"has {MOST_POINTS + 1} points"),
        (["hip"], [point(1, 91)], "point 1 of 'hip': 91.0 degrees is outside -90..90 of servo 1"),
        (["knee"], [point(9, 900)], "point 1 of 'knee': 900.0 degrees is beyond a whole turn"),
        (["knee"], [point(1, 0), point(1.5, 60)], "point 2 of 'knee': 120 degrees per second is faster than 100"),
    ],
)
def test_a_wrong_trajectory_is_refused_with_the_reason(names: list[str], points: list[Any], why: str) -> None:
    with pytest.raises(MotionRefused) as refused:
        read_trajectory(message(names, *points), JOINTS, LIMITS)
    assert why in str(refused.value)
    assert str(refused.value).isprintable()
    assert len(str(refused.value)) < 300


def test_a_begin_far_from_the_present_angles_needs_time() -> None:
    at_once = Trajectory((1,), (0.0, 1.0), ((30.0,), (40.0,)))
    assert at_once.beginning_at({1: 26}, LIMITS) is at_once
    with pytest.raises(MotionRefused, match="begins 31 degrees from servo 1, 0 s after now: faster than 100 "):
        at_once.beginning_at({1: -1}, LIMITS)
    later = Trajectory((1,), (0.5,), ((30.0,),))
    assert later.beginning_at({1: -1}, LIMITS).seconds == (0.0, 0.5)
    with pytest.raises(MotionRefused, match=r"0\.5 s after now: faster"):
        later.beginning_at({1: -60}, LIMITS)


def test_no_points_are_no_trajectory() -> None:
    assert read_trajectory(message([]), JOINTS, LIMITS) is None


def test_a_stamp_says_when_a_trajectory_begins_and_an_old_one_is_refused() -> None:
    assert wait_for(0.0, 1000.0) == 0.0
    assert wait_for(999.5, 1000.0) == 0.0
    assert wait_for(1002.5, 1000.0) == 2.5
    for stamp in (990.0, 1061.0, -5.0):
        with pytest.raises(MotionRefused, match="has the stamp"):
            wait_for(stamp, 1000.0)
