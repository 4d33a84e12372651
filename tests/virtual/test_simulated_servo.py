"""How one servo moves, draws and warms up."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.virtual.simulated_servo import ADC, HIGHEST, LOWEST, SimulatedServo, to_adc, to_degrees


@pytest.fixture
def servo() -> SimulatedServo:
    servo = SimulatedServo(1, angle=0.0, friction=1.0)
    servo.advance(100.0)
    return servo


def test_it_goes_in_a_straight_line(servo: SimulatedServo) -> None:
    servo.move(90, 2.0, 100.0)
    angles = []
    for now in (100.5, 101.0, 101.9, 102.0, 500.0):
        servo.advance(now)
        angles.append(servo.angle)
    assert angles == pytest.approx([22.5, 45.0, 85.5, 90.0, 90.0])
    assert not servo.moving


def test_no_duration_means_at_once(servo: SimulatedServo) -> None:
    servo.move(-30, 0.0, 100.0)
    assert servo.angle == -30
    assert not servo.moving


def test_a_second_move_begins_where_the_first_has_come_to(servo: SimulatedServo) -> None:
    servo.move(100, 1.0, 100.0)
    servo.move(0, 1.0, 100.5)
    assert servo.angle == pytest.approx(50)
    servo.advance(101.0)
    assert servo.angle == pytest.approx(25)
    servo.advance(101.5)
    assert servo.angle == 0


@pytest.mark.parametrize(("asked", "reached"), [(32767, HIGHEST), (-32768, LOWEST), (180, 180), (181, 180)])
def test_its_stops_end_every_move(servo: SimulatedServo, asked: int, reached: float) -> None:
    servo.move(asked, 1.0, 100.0)
    servo.advance(102.0)
    assert servo.angle == reached


@pytest.mark.parametrize(("is_start", "is_hold"), [(0, 1), (1, 0), (0, 0)])
def test_stopped_or_released_it_ends_where_it_is_and_ignores_moves(
    servo: SimulatedServo, is_start: int, is_hold: int
) -> None:
    servo.move(90, 1.0, 100.0)
    servo.set_flags(is_start, is_hold, 100.5)
    servo.move(0, 0.0, 100.6)
    servo.advance(110.0)
    assert servo.angle == pytest.approx(45)
    servo.set_flags(1, 1, 110.0)
    servo.advance(120.0)
    assert servo.angle == pytest.approx(45)
    servo.move(0, 0.0, 120.0)
    assert servo.angle == 0


def test_flags_that_allow_motion_do_not_end_it(servo: SimulatedServo) -> None:
    servo.move(90, 1.0, 100.0)
    servo.set_flags(1, 1, 100.5)
    servo.advance(101.0)
    assert servo.angle == 90


def test_in_adc_it_takes_and_reports_raw_positions(servo: SimulatedServo) -> None:
    servo.unit = ADC
    assert servo.state().angle == 2048
    servo.move(3072, 0.0, 100.0)
    assert servo.state().angle == 3072
    assert servo.angle == pytest.approx(90)


@given(st.integers(0, 4095))
def test_every_raw_position_is_an_angle_and_back(adc: int) -> None:
    assert to_adc(to_degrees(adc)) == adc
    assert LOWEST <= to_degrees(adc) <= HIGHEST


def test_a_raw_position_never_leaves_twelve_bits() -> None:
    assert to_adc(LOWEST) == 0
    assert to_adc(HIGHEST) == 4095


def test_it_draws_most_when_it_moves_fast_and_least_when_it_is_limp(servo: SimulatedServo) -> None:
    holding = servo.state().current
    servo.move(90, 2.0, 100.0)
    slow = servo.state().current
    servo.move(-180, 0.5, 100.1)
    fast = servo.state().current
    servo.set_flags(1, 0, 100.2)
    limp = servo.state().current
    assert 0 <= limp < holding < slow < fast


def test_it_warms_up_while_it_moves_and_cools_down_after(servo: SimulatedServo) -> None:
    cold = servo.state().temperature
    servo.move(180, 120.0, 100.0)
    servo.advance(220.0)
    warm = servo.state().temperature
    servo.set_flags(1, 0, 220.0)
    servo.advance(1000.0)
    assert cold < warm
    assert servo.state().temperature < warm


@given(st.lists(st.floats(0, 3), min_size=1, max_size=20))
def test_the_result_does_not_depend_on_how_often_it_is_advanced(steps: list[float]) -> None:
    often, once = SimulatedServo(1, 0.0, 1.1), SimulatedServo(1, 0.0, 1.1)
    for servo in (often, once):
        servo.advance(0.0)
        servo.move(120, 5.0, 0.0)
    now = 0.0
    for step in steps:
        now += step
        often.advance(now)
    once.advance(now)
    assert often.angle == pytest.approx(once.angle)
    assert often.take_charge() == pytest.approx(once.take_charge())
    assert abs(often.state().temperature - once.state().temperature) <= 1


def test_time_that_runs_backwards_changes_nothing(servo: SimulatedServo) -> None:
    servo.move(90, 1.0, 100.0)
    servo.advance(100.5)
    servo.advance(99.0)
    servo.advance(101.0)
    assert servo.angle == 90


def test_charge_is_given_out_once(servo: SimulatedServo) -> None:
    servo.advance(110.0)
    assert servo.take_charge() == pytest.approx(400.0)
    assert servo.take_charge() == 0


def test_only_a_limp_servo_gives_way_and_no_further_than_its_stops() -> None:
    servo = SimulatedServo(1, angle=10.0, friction=1.0)
    servo.push(50.0)
    assert servo.angle == 10.0
    servo.set_flags(0, 0, 0.0)
    servo.push(50.0)
    assert servo.angle == 50.0
    servo.push(500.0)
    assert servo.angle == 180.0
    servo.set_flags(1, 1, 1.0)
    servo.advance(5.0)
    assert servo.angle == 180.0
