"""SetPoints: whatever is streamed, each movement stays within limits and below the caps. No clock is needed."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import EncodeError, MotionRefused
from servolink.motion.angles import Adc, Degrees
from servolink.motion.limits import MotionLimits, motion_limits
from servolink.motion.set_points import FRESH, SetPoints, checked_set_points
from servolink.protocol import Step

UNIT = 0.01


class Servo:
    """A servo that turns evenly to its last target, as a board does."""

    def __init__(self, angle: float) -> None:
        self.start = angle
        self.target = angle
        self.began = 0.0
        self.seconds = 0.0

    def at(self, now: float) -> float:
        if now >= self.began + self.seconds:
            return self.target
        return self.start + (self.target - self.start) * (now - self.began) / self.seconds

    def obey(self, step: Step, now: float) -> float:
        """Take a movement, and return its speed in degrees per second."""
        self.start, self.target, self.began, self.seconds = self.at(now), step.degree, now, step.interval * UNIT
        return abs(self.target - self.start) / self.seconds


def one_step(points: SetPoints, target: float, now: float) -> Step:
    """Send a set-point of servo 1, and return the movement."""
    (step,) = steps = points.steps({1: target}, now)
    points.sent({1: target}, steps, now)
    return step


ANGLES = st.floats(-400, 400) | st.integers(-400, 400)
SENDINGS = st.tuples(ANGLES, st.floats(0.001, 0.7), st.floats(0, 0.04))
"""A set-point, the seconds since the one before, and the seconds from the computation until it is sent."""


@given(
    st.lists(SENDINGS, min_size=1, max_size=40),
    st.integers(-300, 300),
    st.floats(1.0, 2000.0),
    st.floats(2.0, 100.0),
    st.booleans(),
)
def test_no_movement_is_faster_than_the_cap_whatever_is_streamed_and_however_late(
    sendings: list[tuple[float, float, float]], begin: int, cap: float, hz: float, is_soft: bool
) -> None:
    points = SetPoints(MotionLimits((-90, 90.5), None if is_soft else cap, {}, cap if is_soft else None), hz)
    servo, now = Servo(begin), 0.0
    for target, pause, delay in sendings:
        now += pause
        if points.lacking({1}, now):
            servo = Servo(round(servo.at(now)))  # whole degrees, as a board reports them
            points.read({1: int(servo.target)}, now)
        steps = points.steps({1: target}, now)
        now += delay
        assert is_soft or servo.obey(steps[0], now) <= cap * (1 + 1e-5)
        before = set(points.arrived)
        points.sent({1: target}, steps, now)
        if is_soft and not before:
            assert servo.obey(steps[0], now) <= cap * (1 + 1e-5)
        if is_soft and points.arrived:
            return


@given(st.lists(ANGLES, min_size=1, max_size=20), st.integers(-300, 300))
def test_no_angle_sent_is_farther_outside_the_limits_than_the_servo_was(targets: list[float], begin: int) -> None:
    points = SetPoints(motion_limits((-90, 90.5), 200), 50)
    points.read({1: begin}, 0.0)
    lowest, highest = min(begin, -90), max(begin, 90)
    for number, target in enumerate(targets, 1):
        step = one_step(points, target, number * 0.02)
        assert lowest <= step.degree <= highest
        lowest, highest = min(step.degree, -90), max(step.degree, 90)


@given(st.floats(20.0, 1000.0), st.floats(10.0, 100.0))
def test_a_servo_arrives_nearly_as_fast_as_its_cap_allows(cap: float, hz: float) -> None:
    points, servo = SetPoints(motion_limits(None, cap), hz), Servo(0)
    points.read({1: 0}, 0.0)
    seconds = 0.0
    while servo.at(seconds) < 299.5:
        servo.obey(one_step(points, 300, seconds), seconds)
        seconds += 1 / hz
    assert seconds <= 1.35 * 300 / cap + 0.2


def test_without_caps_the_set_point_itself_is_sent_and_nothing_is_read() -> None:
    points = SetPoints(motion_limits((-90, 90)), 50)
    assert not points.lacking({1}, 0.0)
    assert [one_step(points, target, 0.0) for target in (12.6, -300, 91, 90)] == [
        Step(1, 13, 2),
        Step(1, -90, 2),
        Step(1, 90, 2),
        Step(1, 90, 2),
    ]


def test_the_way_is_shortened_and_the_next_one_begins_where_the_servo_is_by_then() -> None:
    points = SetPoints(motion_limits(None, 100), 50)
    points.read({1: 10}, 0.0)
    assert one_step(points, 90, 0.0) == Step(1, 17, 7)  # a period and 50 ms at the cap
    assert one_step(points, 90, 0.02) == Step(1, 19, 7)
    assert one_step(points, -90, 0.04) == Step(1, 7, 12)  # back; it may be at 19 when this is sent


def test_at_low_caps_a_servo_turns_by_whole_degrees_in_more_time() -> None:
    points = SetPoints(motion_limits(None, 10), 100)
    points.read({1: 0}, 0.0)
    assert one_step(points, 90, 0.0) == Step(1, 1, 10)
    assert one_step(points, 90, 0.05) == Step(1, 1, 5)  # for the rest of the way; the first may be lost
    assert one_step(points, 90, 0.11) == Step(1, 2, 10)


def test_a_servo_outside_its_limits_is_brought_back_at_its_cap() -> None:
    points = SetPoints(motion_limits((-90, 90), 200), 50)
    points.read({1: 170}, 0.0)
    angles = [170, *(one_step(points, 160, number * 0.05).degree for number in range(25))]
    assert angles == sorted(angles, reverse=True)
    assert max(one - other for one, other in pairwise(angles)) <= 14
    assert angles[-1] == 90


def test_a_servo_is_read_again_after_half_a_second_or_another_motion() -> None:
    points = SetPoints(motion_limits(None, 100), 50)
    assert points.lacking({1, 2}, 0.0) == {1, 2}
    points.read({1: 0, 2: 0}, 0.0)
    one_step(points, 90, 0.4)
    assert points.lacking({1, 2}, FRESH + 0.01) == {2}
    points.forget(3)
    assert points.lacking({1, 2}, 0.41) == {1, 2}


def test_only_the_way_to_the_first_set_point_is_soft() -> None:
    points = SetPoints(motion_limits(None, 400, 20), 50)
    points.read({1: 0}, 0.0)
    assert one_step(points, 2, 0.0) == Step(1, 1, 5)
    assert one_step(points, 2, 0.05) == Step(1, 2, 5)
    assert points.arrived == {1}
    assert one_step(points, 90, 0.1) == Step(1, 30, 7)


def test_limits_without_a_whole_angle_allow_nothing() -> None:
    points = SetPoints(MotionLimits((0.2, 0.8)), 50)
    with pytest.raises(MotionRefused, match=r"servo 1: its limits 0.2..0.8 allow no whole angle"):
        points.steps({1: 0.5}, 0.0)
    with pytest.raises(MotionRefused, match="allow no whole angle"):
        SetPoints(MotionLimits((0, 10)).tightened(MotionLimits((20, 30))), 50).steps({1: 15}, 0.0)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf, Adc(100), "45", None, True, [1]])
def test_what_is_no_finite_angle_is_refused_and_never_clamped(wrong: Any) -> None:
    with pytest.raises(EncodeError, match="servo 2: a set-point must be a finite angle in degrees, not"):
        checked_set_points({1: 10, 2: wrong})


@pytest.mark.parametrize("servo_id", [255, -1, 1.5, "x"])
def test_an_impossible_servo_is_refused(servo_id: Any) -> None:
    with pytest.raises(EncodeError, match=r"outside 0..254"):
        checked_set_points({servo_id: 10})


def test_a_set_point_without_servos_is_refused() -> None:
    with pytest.raises(EncodeError, match="no set-points"):
        checked_set_points({})


def test_huge_numbers_are_numbers() -> None:
    checked = checked_set_points({1: 10**400, 2: Degrees(3)})
    assert checked == {1: 10**400, 2: 3}
    assert type(checked[2]) is int  # which JSON can hold
    assert SetPoints(motion_limits((-90, 90)), 50).steps({1: 10**400}, 0.0) == (Step(1, 90, 2),)
