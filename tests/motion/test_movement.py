"""Motion: what is checked and computed before a movement is sent.

Module: servolink.motion.limits.
"""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import EncodeError, MotionRefused
from servolink.motion.angles import wire_angles
from servolink.motion.limits import AngleLimits, MotionLimits, degrees_per_second, motion_limits
from servolink.motion.movement import (
    INTERVAL_UNIT,
    check_limits,
    check_pace,
    checked_targets,
    intervals_for,
    seconds_for,
)

FREE = MotionLimits()


def degrees(servo_id: int) -> Any:
    return "degree"


def adc(servo_id: int) -> Any:
    return "adc"


@pytest.mark.parametrize("servo_id", [-1, 255, 256, 10**30, pytest.param(10**5000, id="huge"), True, 1.0, "1", None])
def test_an_id_that_no_servo_has_is_refused(servo_id: Any) -> None:
    with pytest.raises(EncodeError, match=r"servo id .* is outside 0\.\.254"):
        checked_targets({servo_id: 0})


@pytest.mark.parametrize("targets", [[1], [(1, 2)], 5, None, "1"])
def test_targets_that_are_no_mapping_are_refused(targets: Any) -> None:
    with pytest.raises(TypeError, match="must map servo ids to angles"):
        checked_targets(targets)


def test_no_target_at_all_is_refused() -> None:
    with pytest.raises(EncodeError, match="no targets"):
        checked_targets({})


def test_targets_become_the_numbers_to_send() -> None:
    assert wire_angles({1: 90, 254: -3.0}, degrees) == {1: 90, 254: -3}


@pytest.mark.parametrize("unit", [degrees, adc])
def test_an_angle_of_thousands_of_digits_is_refused(unit: Any) -> None:
    huge = 10**5000
    with pytest.raises(EncodeError, match="this int"):
        check_limits(wire_angles({1: huge}, unit), unit, MotionLimits((-90, 90)))


# --- limits -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("limits", [MotionLimits((-10, 20)), MotionLimits({3: (-10, 20)})])
@pytest.mark.parametrize("angle", [-11, 21, 10**6])
def test_an_angle_outside_its_limits_is_refused(limits: MotionLimits, angle: int) -> None:
    with pytest.raises(EncodeError, match=rf"servo 3: {angle} degrees is outside its limits -10\.\.20"):
        check_limits({3: angle}, degrees, limits)


@pytest.mark.parametrize("angle", [-10, 0, 20])
def test_an_angle_on_its_limit_is_allowed(angle: int) -> None:
    check_limits({3: angle}, degrees, MotionLimits((-10, 20)))
    assert MotionLimits((-10, 20)).of(3) == (-10, 20)


def test_a_servo_without_limits_of_its_own_has_none() -> None:
    limits = MotionLimits({3: (-10, 20)})
    check_limits({4: 180}, degrees, limits)
    assert limits.of(4) is None
    assert FREE.of(3) is None


@pytest.mark.parametrize("limits", [MotionLimits((-10, 20)), MotionLimits(speed_cap=90)])
@pytest.mark.parametrize("unit", [adc, lambda servo_id: None])
def test_limits_hold_nothing_against_angles_in_another_unit(limits: MotionLimits, unit: Any) -> None:
    with pytest.raises(EncodeError, match="in degrees, and this servo is not set to degrees"):
        check_limits({3: 0}, unit, limits)


@pytest.mark.parametrize("cap", [0, -1, math.nan, -math.inf])
def test_a_cap_that_allows_nothing_is_refused(cap: float) -> None:
    with pytest.raises(EncodeError, match="speed_cap"):
        MotionLimits(speed_cap=cap)


@pytest.mark.parametrize("cap", ["1", True, (1, 2)])
def test_a_cap_that_is_no_number_is_refused(cap: Any) -> None:
    with pytest.raises(TypeError, match=r"speed_cap must be a number"):
        MotionLimits(speed_cap=cap)


def test_a_cap_beyond_all_numbers_caps_nothing() -> None:
    for cap in (10**400, math.inf):
        assert intervals_for({1: 90}, {1: 0}, MotionLimits(speed_cap=cap), duration=0.5, speed=None) == {1: 50}


@pytest.mark.parametrize("angles", [[0], 5, "ab", (1,), (1, 2, 3), ("a", "b"), {1: 5}, {1: (0,)}, {1: (0, None)}])
def test_limits_that_are_no_pair_are_refused(angles: Any) -> None:
    with pytest.raises(TypeError, match="angle_limits must be pairs of degrees"):
        MotionLimits(angles)


def test_limits_may_come_from_a_file_and_are_kept_as_they_were_given() -> None:
    given: Any = {1: [0, 90]}
    limits = MotionLimits(given)
    given[1] = [0, 180]
    with pytest.raises(EncodeError, match="outside its limits"):
        check_limits({1: 100}, degrees, limits)


@pytest.mark.parametrize("servo_id", [255, -1, "1", None, 1.0])
def test_limits_for_no_servo_are_refused(servo_id: Any) -> None:
    with pytest.raises(EncodeError, match=r"angle_limits: servo id .* is outside 0\.\.254"):
        MotionLimits({servo_id: (0, 90)})


@pytest.mark.parametrize("angles", [(20, -10), (math.nan, 10), (0, math.nan), {3: (1, 0)}])
def test_limits_that_allow_nothing_are_refused(angles: Any) -> None:
    with pytest.raises(EncodeError, match="angle_limits"):
        MotionLimits(angles)


# --- a cap for each servo, and limits from several sources ----------------------------------------------------------


def test_a_servo_may_have_a_cap_of_its_own() -> None:
    limits = MotionLimits(speed_cap=100, speed_caps={3: 50, 4: 200})
    assert [limits.cap_of(servo_id) for servo_id in (1, 3, 4)] == [100, 50, 100]
    assert MotionLimits(speed_caps={3: 50}).cap_of(1) is None
    assert motion_limits(speed_cap={3: 50}) == MotionLimits(speed_caps={3: 50})
    assert motion_limits(speed_cap=50) == MotionLimits(speed_cap=50)
    with pytest.raises(MotionRefused, match=r"servo 3: 60 degrees in 1 s is 60 degrees/s; its cap is 50$"):
        intervals_for({1: 60, 3: 60}, {1: 0, 3: 0}, limits, duration=1, speed=None)


@pytest.mark.parametrize("caps", [{255: 1}, {3: 0}, {3: math.nan}])
def test_a_cap_for_no_servo_or_no_speed_is_refused(caps: dict[int, float]) -> None:
    with pytest.raises(EncodeError, match=r"speed_cap.*(outside 0\.\.254|must be above 0)"):
        MotionLimits(speed_caps=caps)


@pytest.mark.parametrize("caps", [{3: "1"}, {3: None}, {3: True}, 5, None])
def test_caps_that_are_no_numbers_by_servo_are_refused(caps: Any) -> None:
    with pytest.raises(TypeError, match="speed_cap"):
        MotionLimits(speed_caps=caps)


def test_a_refusal_names_where_the_limit_comes_from() -> None:
    profile = MotionLimits({3: (-80.0, 80.0)}, speed_caps={3: 90}, source='profile "rex"')
    limits = MotionLimits((-90, 90), 120, source="an argument").tightened(profile)
    with pytest.raises(
        MotionRefused, match=r'servo 3: 85 degrees is outside its limits -80\.\.80 \(from profile "rex"\)'
    ):
        check_limits({3: 85}, degrees, limits)
    with pytest.raises(MotionRefused, match=r"outside its limits -90\.\.90 \(from an argument\)"):
        check_limits({4: 95}, degrees, limits)
    with pytest.raises(MotionRefused, match=r'is 100 degrees/s; its cap is 90 \(from profile "rex"\)'):
        intervals_for({3: 50}, {3: 0}, limits, duration=0.5, speed=None)


def test_limits_are_true_if_anything_is_limited() -> None:
    assert not FREE
    assert not FREE.tightened(MotionLimits({}))
    for limits in (MotionLimits((0, 0)), MotionLimits(speed_cap=1), MotionLimits(speed_caps={1: 1})):
        assert limits
        assert FREE.tightened(limits)
    assert MotionLimits(soft_start=1)


def test_limits_with_nothing_in_common_allow_nothing() -> None:
    limits = MotionLimits((0, 10)).tightened(MotionLimits({3: (20, 30)}))
    assert limits.of(3) == (20, 10)
    assert all(limits.exceeded_angles(3, angle) for angle in range(-180, 181))
    assert not limits.exceeded_angles(4, 5)


SPEEDS = st.floats(0.5, 500)
PAIRS = st.tuples(st.integers(-180, 0), st.integers(0, 180))
SOME_ANGLES: st.SearchStrategy[AngleLimits | None] = st.none() | PAIRS | st.dictionaries(st.integers(0, 3), PAIRS)
SINGLE = st.builds(
    MotionLimits,
    SOME_ANGLES,
    st.none() | SPEEDS,
    st.dictionaries(st.integers(0, 3), SPEEDS),
    st.none() | SPEEDS,
    st.sampled_from(["", "an argument"]),
)
LIMITS = st.recursive(SINGLE, lambda each: st.builds(MotionLimits.tightened, each, each), max_leaves=4)


@given(LIMITS, LIMITS, st.integers(0, 3), st.integers(-200, 200), st.floats(0, 10))
def test_combined_limits_allow_just_what_both_allow(
    one: MotionLimits, other: MotionLimits, servo_id: int, angle: int, seconds: float
) -> None:
    for both in (one.tightened(other), other.tightened(one)):
        refused = one.exceeded_angles(servo_id, angle) or other.exceeded_angles(servo_id, angle)
        assert bool(both.exceeded_angles(servo_id, angle)) == bool(refused)
        fast = one.exceeded_cap(servo_id, angle, seconds) or other.exceeded_cap(servo_id, angle, seconds)
        assert bool(both.exceeded_cap(servo_id, angle, seconds)) == bool(fast)
        for limits in (one, other):
            assert (both.cap_of(servo_id) or 0) <= (limits.cap_of(servo_id) or math.inf)
            assert (both.soft_speed_of(servo_id) or 0) <= (limits.soft_speed_of(servo_id) or math.inf)
            assert both.apply_to(servo_id) or not limits.apply_to(servo_id)
            assert bool(both) or not limits
        allowed = both.of(servo_id)
        assert bool(both.exceeded_angles(servo_id, angle)) == (
            allowed is not None and not allowed[0] <= angle <= allowed[1]
        )


# --- time and speed -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pace", [{}, {"duration": 1, "speed": 1}])
def test_either_duration_or_speed_is_given(pace: dict[str, float]) -> None:
    with pytest.raises(EncodeError, match="either duration or speed"):
        seconds_for(1, pace.get("duration"), pace.get("speed"))


@pytest.mark.parametrize(
    "duration", [0, 0.009, -1, 327.68, 1e300, pytest.param(10**5000, id="huge"), math.inf, math.nan, True, "1"]
)
def test_a_duration_that_cannot_be_sent_is_refused(duration: Any) -> None:
    with pytest.raises(EncodeError, match=r"duration .* is outside 0\.01\.\.327\.67 s"):
        seconds_for(1, duration, None)


@pytest.mark.parametrize("speed", [0, -1, math.inf, math.nan, True, "1"])
def test_a_speed_that_is_none_is_refused(speed: Any) -> None:
    with pytest.raises(EncodeError, match="speed must be finite and above 0"):
        seconds_for(1, None, speed)


@pytest.mark.parametrize(("duration", "interval"), [(0.01, 1), (0.011, 2), (0.5, 50), (0.07, 7), (327.67, 32767)])
def test_a_duration_is_sent_in_hundredths_rounded_up(duration: float, interval: int) -> None:
    assert intervals_for({1: 90}, {}, FREE, duration=duration, speed=None) == {1: interval}


@pytest.mark.parametrize(
    ("unit", "duration", "interval"),
    [(0.001, 0.07, 70), (0.02, 0.07, 4), (0.001, 32.767, 32767), (0.02, 655.34, 32767)],
)
def test_a_board_may_count_in_another_unit(unit: float, duration: float, interval: int) -> None:
    assert intervals_for({1: 90}, {}, FREE, duration=duration, speed=None, unit=unit) == {1: interval}


def test_the_possible_durations_are_those_of_the_unit() -> None:
    with pytest.raises(EncodeError, match=r"duration 40 is outside 0\.001\.\.32\.767 s"):
        seconds_for(1, 40, None, 0.001)
    with pytest.raises(EncodeError, match=r"servo 1: 90 s is outside 0\.001\.\.32\.767 s"):
        intervals_for({1: 90}, {1: 0}, FREE, duration=None, speed=1, unit=0.001)
    assert seconds_for(1, 0.01, None) == INTERVAL_UNIT


def test_a_first_movement_is_stretched_as_a_whole() -> None:
    limits = MotionLimits(speed_cap=100, soft_start=30)
    here = {1: 0, 2: 0}
    with pytest.raises(MotionRefused, match="its cap is 100"):
        intervals_for({1: 90, 2: 60}, here, limits, duration=0.5, speed=None)
    assert intervals_for({1: 90, 2: 60}, here, limits, duration=0.5, speed=None, soft={1}) == {1: 300, 2: 300}
    assert intervals_for({1: 90, 2: 60}, here, limits, duration=None, speed=60, soft={2}) == {1: 300, 2: 200}
    assert intervals_for({1: 90, 2: 60}, here, limits, duration=5, speed=None, soft={1, 2}) == {1: 500, 2: 500}
    assert intervals_for({1: 0, 2: 0}, here, limits, duration=0.01, speed=None, soft={1, 2}) == {1: 1, 2: 1}


@given(here=st.integers(-180, 180), there=st.integers(-180, 180), soft=SPEEDS, cap=SPEEDS, speed=st.floats(1e-3, 1e300))
def test_a_first_movement_never_exceeds_its_soft_start(
    here: int, there: int, soft: float, cap: float, speed: float
) -> None:
    limits = MotionLimits(speed_cap=cap, soft_start=soft)
    if abs(there - here) / min(speed, soft, cap) > 327.67:
        with pytest.raises(EncodeError, match=r"is outside 0\.01\.\.327\.67 s"):
            intervals_for({1: there}, {1: here}, limits, duration=None, speed=speed, soft={1})
        return
    interval = intervals_for({1: there}, {1: here}, limits, duration=None, speed=speed, soft={1})[1]
    assert abs(there - here) / (interval / 100) <= min(soft, cap) * (1 + 1e-6)


def test_each_servo_takes_the_time_that_its_way_takes_at_the_speed() -> None:
    here = {1: 0, 2: 45, 3: 90}
    assert intervals_for({1: 90, 2: 90, 3: 90}, here, FREE, duration=None, speed=45) == {1: 200, 2: 100, 3: 1}


def test_each_servo_may_have_a_speed_of_its_own() -> None:
    here = {1: 0, 2: 45}
    assert intervals_for({1: 90, 2: 90}, here, FREE, duration=None, speed={1: 90, 2: 45}) == {1: 100, 2: 100}
    with pytest.raises(EncodeError, match="there is no speed for servo 2"):
        intervals_for({1: 90, 2: 90}, here, FREE, duration=None, speed={1: 90})
    with pytest.raises(EncodeError, match="speed must be finite and above 0"):
        check_pace(None, {1: 90, 2: 0})


def test_a_way_that_takes_too_long_is_refused() -> None:
    for speed, seconds in ((0.1, "900"), (1e-300, r"9e\+301"), (5e-324, "inf")):
        with pytest.raises(EncodeError, match=rf"servo 1: {seconds} s is outside 0\.01\.\.327\.67 s"):
            intervals_for({1: 90}, {1: 0}, FREE, duration=None, speed=speed)


@given(here=st.integers(-180, 180), there=st.integers(-180, 180), speed=st.floats(1.2, 5000))
def test_the_speed_is_never_exceeded(here: int, there: int, speed: float) -> None:
    interval = intervals_for({1: there}, {1: here}, FREE, duration=None, speed=speed)[1]
    assert abs(there - here) / (interval / 100) <= speed * (1 + 1e-6)
    assert interval == 1 or abs(there - here) / ((interval - 1) / 100) > speed


@given(here=st.integers(-180, 180), there=st.integers(-180, 180), duration=st.floats(0.01, 10), cap=st.floats(1, 5000))
def test_the_cap_is_never_exceeded(here: int, there: int, duration: float, cap: float) -> None:
    limits = MotionLimits(speed_cap=cap)
    if abs(there - here) / (math.ceil(duration * 100) / 100) > cap * (1 + 1e-6):
        with pytest.raises(EncodeError, match="its cap is"):
            intervals_for({1: there}, {1: here}, limits, duration=duration, speed=None)
    elif abs(there - here) / duration < cap * (1 - 1e-6):
        interval = intervals_for({1: there}, {1: here}, limits, duration=duration, speed=None)[1]
        assert abs(there - here) / (interval / 100) <= cap * (1 + 1e-9)


def test_a_speed_that_is_just_the_cap_is_allowed_however_it_is_rounded() -> None:
    limits = MotionLimits(speed_cap=100)
    assert not any(limits.exceeded_cap(1, degrees, degrees / 100) for degrees in range(1, 361))
    assert limits.exceeded_cap(1, 30, 0.29) == "100"
    assert not FREE.exceeded_cap(1, 30, 0)


def test_a_turn_in_no_time_is_infinitely_fast_and_no_turn_is_not() -> None:
    assert (degrees_per_second(-30, 0.5), degrees_per_second(30, 0), degrees_per_second(0, 0)) == (60, math.inf, 0)


def test_a_speed_above_the_cap_is_refused_with_both() -> None:
    with pytest.raises(EncodeError, match=r"servo 1: 90 degrees in 0\.5 s is 180 degrees/s; its cap is 90"):
        intervals_for({1: 90}, {1: 0}, MotionLimits(speed_cap=90), duration=0.5, speed=None)
    assert intervals_for({1: 90}, {1: 0}, MotionLimits(speed_cap=90), duration=1, speed=None) == {1: 100}
