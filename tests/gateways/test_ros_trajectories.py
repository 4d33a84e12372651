"""Trajectories of ROS without ROS: joints by name, what is refused and why, and angles between points.

Module: servolink.gateways.ros.trajectories.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import MotionRefused
from servolink.gateways.ros.trajectories import (
    MOST_POINTS,
    RosGoal,
    Trajectory,
    TrajectoryRefused,
    joints_of,
    read_trajectory,
    seconds_until,
)
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
    assert seconds_until(0.0, 1000.0) == 0.0
    assert seconds_until(999.5, 1000.0) == 0.0
    assert seconds_until(1002.5, 1000.0) == 2.5
    for stamp in (990.0, 1061.0, -5.0):
        with pytest.raises(MotionRefused, match="has the stamp"):
            seconds_until(stamp, 1000.0)


def row(name: str, position: float, **more: float) -> Any:
    """Return an object with the fields of a `control_msgs/JointTolerance`."""
    return SimpleNamespace(name=name, position=position, **({"velocity": 0.0, "acceleration": 0.0} | more))


def goal_message(trajectory: Any, *, late: float = 0.0, **more: Sequence[Any]) -> Any:
    """Return an object with the fields of a goal of `control_msgs/FollowJointTrajectory`."""
    lists: dict[str, Sequence[Any]] = dict.fromkeys(("path_tolerance", "goal_tolerance"), ())
    lists |= dict.fromkeys(("component_path_tolerance", "component_goal_tolerance"), ())
    time = SimpleNamespace(sec=math.floor(late), nanosec=round(late % 1 * 1e9))
    several = SimpleNamespace(points=())
    return SimpleNamespace(
        trajectory=trajectory, multi_dof_trajectory=several, goal_time_tolerance=time, **(lists | more)
    )


WAY = message(["hip"], point(1, 0), point(2, 40))


@pytest.mark.parametrize(
    ("goal", "code", "why"),
    [
        (goal_message(WAY, path_tolerance=[row("knee", 1)]), -2, "a tolerance for 'knee', which it does not move"),
        (goal_message(WAY, path_tolerance=[row("hip", NAN)]), -1, "a tolerance of 'hip' other than radians"),
        (goal_message(WAY, goal_tolerance=[row("hip", -2)]), -1, "a tolerance of 'hip' other than radians"),
        (goal_message(WAY, goal_tolerance=[row("hip", 0, velocity=1)]), -1, "speeds are not reported"),
        (goal_message(WAY, late=-1), -1, "a goal_time_tolerance outside 0..3600 s"),
        (goal_message(WAY, component_path_tolerance=[1]), -1, "other joints"),
        (goal_message(message(["hip"])), -1, "has no points"),
    ],
)
def test_a_goal_that_cannot_be_kept_is_refused_with_a_code(goal: Any, code: int, why: str) -> None:
    with pytest.raises(TrajectoryRefused) as refused:
        RosGoal(goal).check()
    assert refused.value.code == code
    assert why in str(refused.value)


def test_refusals_have_the_codes_of_ros() -> None:
    for names, stamp, code in ((["tail"], 0.0, -2), ([], 0.0, -2), (["hip"], 5.0, -3)):
        with pytest.raises(TrajectoryRefused) as refused:
            seconds_until(stamp, 1000.0) if stamp else read_trajectory(message(names, point(1, 0)), JOINTS, LIMITS)
        assert refused.value.code == code


def seeing(**more: Any) -> Callable[[float, float, float], bool]:
    """Return what a goal of the hip says of an angle in degrees, at the time of its reading, and the time now."""
    goal, found = RosGoal(goal_message(WAY, **more)), read_trajectory(WAY, JOINTS, LIMITS)
    assert found is not None
    goal.check()
    return lambda degrees, at, now: goal.see(found, now, at, {"hip": math.radians(degrees)})


def test_a_goal_is_reached_when_the_angle_is_seen_near_it_after_the_end() -> None:
    sees = seeing()
    assert not sees(40, 1.9, 1.9)
    assert not sees(-80, 1.9, 1.95), "no tolerance is given for the path"
    assert not sees(37.9, 2.5, 2.5)
    assert sees(38.1, 2.5, 2.5)
    assert sees(41.9, 1.9, 3.1), "the latest reading counts, when time is over"
    with pytest.raises(TrajectoryRefused, match=r"'hip' is 2.1 degrees from its goal, too late; 2.0 are") as refused:
        sees(37.9, 3.0, 3.1)
    assert refused.value.code == -5


def test_tolerances_of_a_goal_are_kept() -> None:
    degree = math.radians(1)
    sees = seeing(path_tolerance=[row("hip", 5 * degree)], goal_tolerance=[row("hip", 10 * degree)], late=4)
    assert not sees(15.1, 1.5, 1.5)
    assert sees(30.1, 2.0, 2.0)
    assert not sees(29.9, 5.9, 5.9)
    with pytest.raises(TrajectoryRefused, match=r"'hip' is 5.1 degrees from the trajectory; 5.0 are") as refused:
        sees(14.9, 1.5, 1.5)
    assert refused.value.code == -4
    with pytest.raises(TrajectoryRefused, match=r"is 10.1 degrees from its goal"):
        sees(29.9, 6.1, 6.1)
    assert seeing(goal_tolerance=[row("hip", -1)])(-90, 2.0, 2.0)


def test_a_joint_that_reports_no_angle_is_not_at_its_goal() -> None:
    goal, found = RosGoal(goal_message(WAY)), read_trajectory(WAY, JOINTS, LIMITS)
    assert found is not None
    goal.check()
    assert not goal.see(found, 2.5, 2.5, {})
    with pytest.raises(TrajectoryRefused, match="'hip' is inf degrees from its goal"):
        goal.see(found, 3.5, 3.5, {})


def test_a_result_is_given_once_and_feedback_ten_times_a_second() -> None:
    results: list[tuple[int, str]] = []
    seen: list[tuple[dict[str, float], dict[str, float]]] = []
    goal = RosGoal(goal_message(WAY), lambda *each: results.append(each), lambda *each: seen.append(each))
    found = read_trajectory(WAY, JOINTS, LIMITS)
    assert found is not None
    goal.check()
    for step in range(75):
        goal.see(found, step / 50, step / 50, {"hip": 0.0})
    assert 12 <= len(seen) <= 15
    assert seen[0] == ({"hip": 0.0}, {"hip": 0.0})
    assert seen[-1][1]["hip"] == pytest.approx(seen[-1][0]["hip"])
    goal.settle("one")
    goal.settle("other", 0)
    RosGoal().settle("a trajectory of the topic has no result")
    assert results == [(-1, "one")]
