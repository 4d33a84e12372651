"""Motion: what is checked and computed before a movement is sent."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import EncodeError
from servolink.motion import (
    MotionLimits,
    check_limits,
    checked_targets,
    degrees_per_second,
    intervals_for,
    seconds_for,
    wire_angles,
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


def test_each_servo_takes_the_time_that_its_way_takes_at_the_speed() -> None:
    here = {1: 0, 2: 45, 3: 90}
    assert intervals_for({1: 90, 2: 90, 3: 90}, here, FREE, duration=None, speed=45) == {1: 200, 2: 100, 3: 1}


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
    assert not any(limits.too_fast(degrees, degrees / 100) for degrees in range(1, 361))
    assert limits.too_fast(30, 0.29)
    assert not FREE.too_fast(30, 0)


def test_a_turn_in_no_time_is_infinitely_fast_and_no_turn_is_not() -> None:
    assert (degrees_per_second(-30, 0.5), degrees_per_second(30, 0), degrees_per_second(0, 0)) == (60, math.inf, 0)


def test_a_speed_above_the_cap_is_refused_with_both() -> None:
    with pytest.raises(EncodeError, match=r"servo 1: 90 degrees in 0\.5 s is 180 degrees/s; its cap is 90"):
        intervals_for({1: 90}, {1: 0}, MotionLimits(speed_cap=90), duration=0.5, speed=None)
    assert intervals_for({1: 90}, {1: 0}, MotionLimits(speed_cap=90), duration=1, speed=None) == {1: 100}
