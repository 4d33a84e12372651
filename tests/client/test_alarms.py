"""Alarms on raw values: when they are raised, what stops the robot, and what no reading loses."""

from __future__ import annotations

import asyncio
import gc
from typing import Any

import pytest

from servolink.client.alarms import Alarm, AlarmWatch
from servolink.client.servo_readings import _RatedReader
from servolink.client.servo_state import Servo
from servolink.errors import OutcomeUnknown
from servolink.protocol import SetServoParameterRequest
from tests.client.piped_board import LOST, PipedBoard, opened


def servo(servo_id: int = 1, *, current: int = 0, temperature: int = 0) -> Servo:
    return Servo(servo_id, 0, current, temperature, 1, is_start=True, is_hold=True)


def raised(watch: AlarmWatch, *currents: int, period: float = 0.1) -> list[int]:
    """Return the numbers of the readings that raise an alarm."""
    return [at for at, current in enumerate(currents) if watch.check([servo(current=current)], round(at * period, 6))]


@pytest.mark.parametrize(
    ("text", "alarm"),
    [
        ("temperature_raw>300", Alarm("temperature_raw", ">", 300)),
        (" current_raw < -5 ", Alarm("current_raw", "<", -5)),
        ("current_raw>800 for 0.5s", Alarm("current_raw", ">", 800, 0.5)),
        ("current_raw > 800 for 2 s", Alarm("current_raw", ">", 800, 2.0)),
    ],
)
def test_an_alarm_is_read_and_written_as_text(text: str, alarm: Alarm) -> None:
    assert Alarm.parse(text) == alarm
    assert Alarm.parse(str(alarm)) == alarm
    assert Alarm.parse(text, stops=True).stops


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "an alarm looks like 'temperature_raw>300' or 'current_raw>800 for 0.5s', not like ''"),
        ("temperature_raw=3", "not like 'temperature_raw=3'"),
        ("current_raw>٣", "not like"),
        ("current_raw>1 for 5", "not like"),
        ("current_raw>1 for 9999s", "the time of an alarm must be from 0 to 3600 s, not 9999.0"),
        ("celsius>40", "an alarm is about current_raw or temperature_raw, not 'celsius'"),
        ("x\x1b[2J>1", r"not like 'x\\x1b\[2J>1'"),
    ],
)
def test_what_is_no_alarm_is_refused(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Alarm.parse(text)


@pytest.mark.parametrize(
    ("values", "error"),
    [
        (("current_raw", "=", 1), ValueError),
        (("current_raw", ">", 1.5), TypeError),
        (("current_raw", ">", True), TypeError),
        (("current_raw", ">", 1, float("nan")), ValueError),
        (("current_raw", ">", 1, -1.0), ValueError),
    ],
)
def test_an_alarm_that_cannot_be_is_refused(values: tuple[Any, ...], error: type[Exception]) -> None:
    with pytest.raises(error):
        Alarm(*values)


def test_one_alarm_for_as_long_as_a_value_is_bad() -> None:
    assert raised(AlarmWatch([Alarm.parse("current_raw>800")]), 800, 801, 900, 800, 801) == [1, 4]


def test_a_value_has_to_be_bad_all_the_time() -> None:
    alarm = Alarm.parse("current_raw>800 for 0.3s")
    assert raised(AlarmWatch([alarm]), 900, 900, 900, 0, 900, 900, 900, 900, 900) == [7]


def test_each_servo_and_each_alarm_counts_for_itself() -> None:
    watch = AlarmWatch([Alarm.parse("current_raw>5"), Alarm.parse("temperature_raw<5")])
    found = watch.check([servo(1, current=6, temperature=9), servo(2, current=7, temperature=4)], 0.0)
    assert [str(each) for each in found] == [
        "servo 1: current_raw is 6 (alarm current_raw>5)",
        "servo 2: current_raw is 7 (alarm current_raw>5)",
        "servo 2: temperature_raw is 4 (alarm temperature_raw<5)",
    ]


@pytest.mark.virtual_only("hobby servos measure neither current nor temperature")
async def test_an_alarm_stops_the_servos_and_reading_goes_on() -> None:
    fake = PipedBoard(servos=2)
    async with opened(fake) as board, board.watch(50, alarms=[Alarm.parse("current_raw>50", stops=True)]) as found:
        assert (await anext(found)).alarms == ()
        await board.move({1: 90}, duration=5)
        async with asyncio.timeout(1):
            while not (reading := await anext(found)).alarms:
                pass
            assert [each.servo_id for each in reading.alarms] == [1]
            while not all(servo.state == "stopped" for servo in reading.servos):
                reading = await anext(found)
        assert 0 <= (await board.servo(1)).angle < 45


@pytest.mark.virtual_only("hobby servos measure neither current nor temperature")
async def test_a_slow_program_is_told_what_was_raised_meanwhile_and_the_stop_does_not_wait_for_it() -> None:
    fake = PipedBoard(servos=1)
    alarms = [Alarm.parse("current_raw>50", stops=True), Alarm.parse("current_raw>51")]
    async with opened(fake) as board, board.watch(50, alarms=alarms) as found:
        await anext(found)
        await board.move({1: 90}, duration=5)
        await asyncio.sleep(1)
        assert len(fake.executed_of(SetServoParameterRequest)) == 1
        reading = await anext(found)
        assert [each.alarm for each in reading.alarms] == alarms
        assert reading.servos[0].state == "stopped"
        assert (await anext(found)).alarms == ()


@pytest.mark.virtual_only("hobby servos measure neither current nor temperature")
async def test_an_iterator_that_python_collects_while_alarms_are_checked_swallows_no_stop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    offer = _RatedReader.offer

    def collecting(reader: _RatedReader, *of: Any) -> bool:
        monkeypatch.setattr(_RatedReader, "offer", offer)
        gc.collect()
        return offer(reader, *of)

    fake = PipedBoard(servos=1)
    async with opened(fake) as board:
        async with board.watch(50, alarms=[Alarm.parse("temperature_raw>0", stops=True)]):
            dropped = board.watch(50)
            await dropped.__aenter__()
            cycle: list[object] = [dropped]
            cycle.append(cycle)
            del dropped, cycle
            monkeypatch.setattr(_RatedReader, "offer", collecting)
            await asyncio.sleep(0.1)
        assert len(fake.executed_of(SetServoParameterRequest)) == 1


@pytest.mark.virtual_only("hobby servos measure neither current nor temperature")
async def test_a_stop_is_finished_before_the_board_is_closed() -> None:
    fake = PipedBoard(servos=1)
    async with opened(fake) as board:
        async for reading in board.watch(50, alarms=[Alarm.parse("temperature_raw>0", stops=True)]):
            assert reading.alarms
            break
    assert len(fake.executed_of(SetServoParameterRequest)) == 1


@pytest.mark.virtual_only("hobby servos measure neither current nor temperature")
async def test_a_stop_that_cannot_be_confirmed_is_raised() -> None:
    fake = PipedBoard(servos=1)
    async with opened(fake) as board, board.watch(50, alarms=[Alarm.parse("current_raw>50", stops=True)]) as found:
        quiet = board.watch(50, alarms=[Alarm.parse("current_raw>5000")])
        await anext(found)
        await anext(quiet)
        fake.plan(SetServoParameterRequest, LOST, LOST, LOST)
        await board.move({1: 90}, duration=5)
        with pytest.raises(OutcomeUnknown, match="an alarm was raised, and the servos may still move: a stop was"):
            async for _ in found:
                pass
        await anext(quiet)


@pytest.mark.parametrize(
    ("alarms", "words"),
    [
        ("current_raw>1", r"alarms must be a list of alarms, such as \[Alarm\.parse\(...\)\], not 'current_raw>1'"),
        (Alarm.parse("current_raw>1"), r"alarms must be a list of alarms, such as \[Alarm\.parse\(...\)\], not "),
        (["current_raw>1"], r"alarms must be of type Alarm, not 'current_raw>1'; see Alarm\.parse"),
    ],
)
async def test_what_is_no_list_of_alarms_is_refused(alarms: Any, words: str) -> None:
    async with opened(PipedBoard()) as board:
        with pytest.raises(TypeError, match=words):
            board.watch(alarms=alarms)
