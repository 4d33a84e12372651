"""The guard by itself: readings and courses in, stalls and warnings out.

Module: servolink.hub.rules.guard.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from random import Random

import pytest
from msgspec.structs import replace

from servolink.client import Servo
from servolink.hub.rules.guard import Guard, Stall
from servolink.motion import Degrees, ServoWay
from tests.hub.guard_measured import detection, false_alarms

Current = Callable[[int], int]


def servo(angle: float, current: int = 100, temperature: int = 250, *, start: bool = True, hold: bool = True) -> Servo:
    return Servo(1, Degrees(round(angle)), current, temperature, 1, start, hold)


class Robot:
    """A servo that is moved to and fro at 60 degrees/s, read by a guard at a rate."""

    def __init__(self, hz: float = 10.0, scaled: Current = lambda current: current, **guard: int) -> None:
        self.guard = Guard(**guard)
        self.now = 0.0
        self._hz = hz
        self._scaled = scaled
        self._noise = Random(3)
        self._here = 0.0

    def move(
        self, target: int, most: float = 180, sag: float = 0.0, seconds: float = 3.0
    ) -> Iterator[tuple[float, Stall]]:
        """Yield the stalls, each with its seconds since the servo has met something at the angle `most`."""
        way = ServoWay(self._here, target, self.now, abs(target - self._here) / 60)
        met = self.now + max(0.0, (most - self._here) / 60)
        for _ in range(round(seconds * self._hz)):
            self.now += 1 / self._hz
            angle = way.at(self.now) - sag
            current = 900 if angle > most else 120 if self.now < way.began + way.seconds else 80
            read = servo(min(angle, most), self._scaled(current + self._noise.randint(-20, 20)))
            for stall in self.guard.stalls([read], lambda servo_id: way, self.now):
                yield self.now - met, stall
        self._here = float(target)

    def learn(self) -> Robot:
        for target in (60, -60, 60, 0):
            assert not list(self.move(target))
        return self


@pytest.mark.parametrize(("hz", "most"), [(10.0, 1.0), (50.0, 0.5)])
def test_a_stall_is_found_in_time(hz: float, most: float) -> None:
    robot = Robot(hz).learn()
    [(seconds, stall)] = robot.move(60, most=20)
    assert 0.25 <= seconds <= most
    assert (stall.servo_id, stall.angle, stall.target) == (1, 20, 60)
    assert stall.current > 850
    assert stall.normal is not None
    assert 100 <= stall.normal <= 140
    assert str(stall).startswith("servo 1 is stalled: for 0.")


def test_a_servo_is_eased_off_by_two_degrees_against_its_push_and_not_past_where_it_came_from() -> None:
    [(_, stall)] = Robot().learn().move(60, most=20)
    assert stall.reached is not None
    assert 0 < stall.reached < 18
    assert [stall.eased(angle) for angle in (20, 21, 18, 22, 23, 17)] == [18, 19, 16, 20, None, None]
    near = replace(stall, reached=19)
    assert [near.eased(angle) for angle in (21, 20, 19, 18)] == [19, 19, None, None]
    back = replace(stall, angle=-20, reached=-3)
    assert [back.eased(angle) for angle in (-20, -21, -23)] == [-18, -19, None]
    assert replace(stall, reached=None).eased(20) is None


def test_a_servo_that_is_stuck_where_it_has_arrived_has_no_way_back() -> None:
    robot = Robot().learn()
    assert not list(robot.move(-40))
    [(_, stall)] = robot.move(60, most=-40)
    assert stall.reached is None, "it came from above, and presses upward now"


def test_what_is_normal_is_taken_over_with_its_age() -> None:
    learnt, at = Robot().learn(), datetime(2026, 1, 31, tzinfo=UTC)
    kept = learnt.guard.kept(learnt.now, at)
    assert 3 < kept[1].seconds < 15
    assert timedelta() <= at - kept[1].learnt_at < timedelta(seconds=2)
    robot = Robot()
    robot.guard.recall(kept, robot.now, at + timedelta(days=2))
    again = robot.guard.kept(robot.now, at + timedelta(days=2))
    assert again[1].learnt_at == kept[1].learnt_at, "nothing was learnt since"
    assert again[1].moving == kept[1].moving
    assert robot.guard.learnt == 0
    [(seconds, stall)] = robot.move(60, most=20)
    assert seconds < 1.0
    assert stall.normal is not None


@pytest.mark.parametrize("scaled", [lambda current: 2048 + 3 * current, lambda current: current // 10 - 50])
def test_neither_unit_nor_zero_of_the_currents_matters(scaled: Current) -> None:
    found = [
        [seconds for seconds, _ in Robot(10, each).learn().move(60, most=20)] for each in (scaled, lambda one: one)
    ]
    assert found[0] == found[1]


def test_without_a_normal_the_lag_alone_says_it_later() -> None:
    [(seconds, stall)] = Robot().move(120, most=20)
    assert 1.0 <= seconds <= 1.5
    assert stall.normal is None
    [(seconds, stall)] = Robot(scaled=lambda current: 0).learn().move(120, most=20)
    assert 1.0 <= seconds <= 1.5
    assert "the lag alone says this" in str(stall)


def test_a_servo_that_draws_no_more_than_its_normal_is_not_stalled() -> None:
    robot = Robot(scaled=lambda current: min(current, 60 + current % 40)).learn()
    assert not list(robot.move(60, most=20))


def test_sagging_under_a_load_is_learnt_and_is_no_stall() -> None:
    robot = Robot()
    for target in (60, -60) * 5:
        assert not list(robot.move(target, sag=4.0, seconds=5))
    normal = robot.guard.normal(1)
    assert normal is not None
    assert normal.most_lag == 8
    assert not list(robot.move(60, sag=7.0))


@pytest.mark.parametrize(("start", "hold", "after"), [(True, True, 1.1), (False, True, 0.0), (True, False, 0.0)])
def test_only_commanded_motion_can_stall(*, start: bool, hold: bool, after: float) -> None:
    robot = Robot().learn()
    way = ServoWay(0.0, 60, robot.now, 1.0)
    for tick in range(100):
        now = way.began + way.seconds + after + tick / 10 if after else way.began + tick / 10
        read = servo(20, 900, start=start, hold=hold)
        assert not list(robot.guard.stalls([read], lambda servo_id: way, now)), now


def test_two_readings_across_a_silence_are_too_few() -> None:
    robot = Robot().learn()
    way = ServoWay(0.0, 60, robot.now, 60.0)
    assert not any(list(robot.guard.stalls([servo(0, 900)], lambda servo_id: way, way.began + at)) for at in (20, 30))
    assert list(robot.guard.stalls([servo(0, 900)], lambda servo_id: way, way.began + 31))


def test_a_doubtful_reading_says_nothing() -> None:
    robot = Robot().learn()
    way = ServoWay(0.0, 60, robot.now, 60.0)
    read = Servo(1, Degrees(-1), -1, -1, -1, is_start=True, is_hold=True, doubt="not measured")
    assert not any(list(robot.guard.stalls([read], lambda servo_id: way, way.began + at)) for at in range(20, 30))


def warnings(guard: Guard, *temperatures: float) -> list[tuple[int, str]]:
    """Return the warnings of a reading each second, with the seconds."""
    return [
        (at, text)
        for at, temperature in enumerate(temperatures)
        for text in guard.warnings([servo(0, temperature=round(temperature))], float(at))
    ]


def test_a_temperature_warns_a_minute_before_its_limit_and_at_it() -> None:
    rising = (250 + at / 2 for at in range(300))
    [(early, forecast), (late, reached)] = warnings(Guard(hottest=350), *rising)
    assert 139 <= early <= 145, "350 is passed after 200 s"
    assert forecast.startswith("servo 1: temperature_raw is 32")
    assert "passes 350 in 5" in forecast
    assert (late, reached[:32]) == (202, "servo 1: temperature_raw is 351 ")


def test_a_steady_temperature_warns_of_nothing() -> None:
    noise = Random(1)
    assert not warnings(Guard(hottest=350), *(345 + noise.choice((-2, 0, 2)) for _ in range(600)))
    assert not warnings(Guard(), *range(250, 900))


@pytest.mark.parametrize(("hz", "most"), [(10.0, 1.0), (50.0, 0.5)])
def test_a_body_with_physics_is_stopped_in_time_and_never_without_reason(hz: float, most: float) -> None:
    pytest.importorskip("mujoco")
    assert not list(false_alarms(1, 2.0))
    found = [detection(seed, hz) for seed in (500_001, 500_003)]
    assert [each[1] is not None and each[1] <= most for each in found if each is not None] == [True] * 2
