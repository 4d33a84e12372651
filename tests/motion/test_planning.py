"""Plans: packet and time of a movement, without a board and without a clock."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import EncodeError, MotionRefused
from servolink.motion.angles import Adc, Degrees
from servolink.motion.limits import MotionLimits
from servolink.motion.movement import MotionPlanner, Movement
from servolink.protocol import ExecuteActionRequest, Step

FREE = MotionPlanner(MotionLimits())


def degrees(servo_id: int) -> Any:
    return "degree"


def adc_of_2(servo_id: int) -> Any:
    return "adc" if servo_id == 2 else "degree"


def test_a_plan_has_the_packet_the_goals_and_the_time() -> None:
    plan = FREE.plan(Movement({1: 30, 2: Adc(2000)}, duration=0.07), adc_of_2, {}, ())
    assert plan.packet == ExecuteActionRequest((Step(1, 30, 7), Step(2, 2000, 7)))
    assert (plan.goals, plan.seconds) == ({1: Degrees(30), 2: Adc(2000)}, 0.07)


def test_each_servo_has_the_time_that_its_way_takes() -> None:
    plan = FREE.plan(Movement({1: 30, 2: 60}, speed=30), degrees, {1: 0, 2: 0}, ())
    assert plan.packet.steps == (Step(1, 30, 100), Step(2, 60, 200))
    assert plan.seconds == 2


def test_another_interval_unit_changes_the_packet_and_not_the_time() -> None:
    plan = MotionPlanner(MotionLimits(), 0.02).plan(Movement({1: 30}, duration=1), degrees, {}, ())
    assert (plan.packet.steps, plan.seconds) == ((Step(1, 30, 50),), 1)


def test_a_first_movement_takes_as_long_as_the_soft_start() -> None:
    planner = MotionPlanner(MotionLimits(soft_start=10))
    movement = Movement({1: 30, 2: 5}, duration=1)
    assert planner.plan(movement, degrees, {1: 0, 2: 0}, {1}).packet.steps == (Step(1, 30, 300), Step(2, 5, 300))
    assert planner.plan(movement, degrees, {}, ()).seconds == 1


@pytest.mark.parametrize(
    ("limits", "movement", "is_needed"),
    [
        (MotionLimits(), Movement({1: 30}, duration=1), False),
        (MotionLimits(), Movement({1: 30}, speed=30), True),
        (MotionLimits((-90, 90)), Movement({1: 30}, duration=1), False),
        (MotionLimits((-90, 90)), Movement({1: 95}, duration=1), True),
        (MotionLimits(speed_caps={1: 100}), Movement({1: 30}, duration=1), True),
        (MotionLimits(speed_caps={2: 100}), Movement({1: 30}, duration=1), False),
    ],
)
def test_the_pose_is_needed_where_the_plan_depends_on_it(
    limits: MotionLimits, movement: Movement, is_needed: bool
) -> None:
    assert MotionPlanner(limits).needs_pose(movement, ()) == is_needed


def test_the_pose_is_needed_for_a_first_movement() -> None:
    assert MotionPlanner(MotionLimits(soft_start=10)).needs_pose(Movement({1: 30}, duration=1), {1})


def test_a_movement_that_no_pose_allows_is_refused_before_the_pose_is_read() -> None:
    planner = MotionPlanner(MotionLimits({1: (-90, 90)}))
    with pytest.raises(MotionRefused, match=r"360"):
        planner.check(Movement({2: 400}, duration=1), degrees)
    with pytest.raises(MotionRefused, match="not set to degrees"):
        planner.check(Movement({2: Adc(400)}, speed=10), adc_of_2)
    with pytest.raises(EncodeError, match="adc"):
        planner.check(Movement({2: 400}, duration=1), adc_of_2)
    planner.check(Movement({2: 400}, duration=1, any_angle=True), degrees)
    planner.check(Movement({1: 95}, duration=1), degrees)  # the servo may be beyond its limits already


def test_a_servo_beyond_its_limits_may_turn_toward_them() -> None:
    planner = MotionPlanner(MotionLimits({1: (-90, 90)}))
    assert planner.plan(Movement({1: 95}, duration=1), degrees, {1: Degrees(100)}, ()).goals == {1: 95}
    with pytest.raises(MotionRefused, match="outside its limits"):
        planner.plan(Movement({1: 95}, duration=1), degrees, {1: Degrees(0)}, ())


def test_steps_that_cannot_be_slower_are_refused_beyond_a_cap_and_a_soft_start() -> None:
    planner = MotionPlanner(MotionLimits(speed_cap=100, soft_start=10))
    steps = (Step(1, 30, 50),)
    planner.check_steps(steps, degrees, {1: 0}, ())
    with pytest.raises(MotionRefused, match="soft start allows 10"):
        planner.check_steps(steps, degrees, {1: 0}, {1})
    with pytest.raises(MotionRefused, match="its cap is 100"):
        planner.check_steps((Step(1, 60, 50),), degrees, {1: 0}, ())


@given(
    st.dictionaries(st.integers(0, 254), st.integers(-180, 180), min_size=1, max_size=8),
    st.integers(-180, 180),
    st.floats(0.1, 10),
    st.floats(20, 500),
    st.sampled_from([0.01, 0.02]),
)
def test_what_is_planned_passes_the_check_of_steps(
    targets: dict[int, int], here: int, duration: float, cap: float, unit: float
) -> None:
    planner = MotionPlanner(MotionLimits((-180, 180), speed_cap=cap, soft_start=15), unit)
    pose = dict.fromkeys(targets, here)
    plan = planner.plan(Movement(targets, duration=duration), degrees, pose, targets)
    planner.check_steps(plan.packet.steps, degrees, pose, targets)
    assert plan.seconds == planner.seconds_of(plan.packet.steps)
