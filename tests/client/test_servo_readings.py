"""Readings of all servos: one poll for any number of readers, as fast as the fastest wants."""

from __future__ import annotations

import asyncio
import gc
from itertools import pairwise

import pytest

from servolink.client import connecting
from servolink.client.connecting import connect
from servolink.client.servo_readings import ServoReading, ServoReadings
from servolink.errors import ConnectionLost, RequestTimeout
from servolink.motion import Adc, Degrees
from servolink.protocol import QueryServoRequest, SetAngleUnitRequest
from servolink.testing import Fate
from tests.client.line_board import LineBoard
from tests.client.piped_board import LOST, PipedBoard, late, opened


async def read(readings: ServoReadings, seconds: float) -> list[ServoReading]:
    """Return the readings of the next `seconds` seconds."""
    loop = asyncio.get_running_loop()
    end, found = loop.time() + seconds, []
    async for reading in readings:
        found.append(reading)
        if loop.time() >= end:
            break
    return found


def queries(fake: PipedBoard) -> list[float]:
    return fake.sent_of(QueryServoRequest)


# --- readings -----------------------------------------------------------------------------------------------------


async def test_a_reading_has_all_servos_and_the_time_when_they_came() -> None:
    fake = PipedBoard(servos=3)
    async with opened(fake) as board:
        first, second = (await read(board.watch(), 0.02))[:2]
        assert [servo.servo_id for servo in first.servos] == [servo.servo_id for servo in await board.servos()]
        assert all(isinstance(servo.angle, Degrees) for servo in (*first.servos, *second.servos))
        assert [first.seconds, second.seconds] == fake.answered_at[2:4]  # after the unit and the list of servos
        assert first.missed == second.missed == 0


async def test_angles_are_in_the_unit_that_is_set_meanwhile() -> None:
    fake = PipedBoard()
    async with opened(fake) as board, board.watch() as readings:
        await anext(readings)
        await board.set_angle_unit("adc")
        await anext(readings)
        assert isinstance((await anext(readings)).servos[0].angle, Adc)
        assert len(fake.executed_of(SetAngleUnitRequest)) == 2


async def test_without_a_rate_each_reading_follows_the_one_before() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        found = await read(board.watch(), 1)
        assert len(found) == pytest.approx(1 / 0.004, rel=0.02)
        assert sum(reading.missed for reading in found) == 0


async def test_nothing_is_asked_before_the_first_wait_nor_after_the_end() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        readings = board.watch()
        await asyncio.sleep(0.1)
        assert queries(fake) == []
        async with readings:
            await anext(readings)
        await asyncio.sleep(0.1)
        asked = len(queries(fake))
        await asyncio.sleep(0.1)
        assert len(queries(fake)) == asked <= 3
        with pytest.raises(StopAsyncIteration):
            await anext(readings)


@pytest.mark.parametrize("hz", [None, 100])
async def test_break_ends_reading(hz: float | None) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        async for _ in board.watch(hz):
            break
        gc.collect()
        await asyncio.sleep(0.1)
        asked = len(queries(fake))
        await asyncio.sleep(0.1)
        assert len(queries(fake)) == asked


async def test_at_a_greater_depth_the_line_is_filled() -> None:
    shares = []
    for depth in (1, 16):
        board = LineBoard(turnaround=0)
        board.latency = 0.016
        async with connect(board, depth=depth) as connected:
            found = await read(connected.watch(), 20)
            shares.append(len(found) * 186 / board.pace / 20)
            assert sum(reading.missed for reading in found) == 0
            assert all(one.seconds < other.seconds for one, other in pairwise(found))
    assert shares[0] < 0.55
    assert shares[1] > 0.9


async def test_others_wait_for_no_more_than_what_is_on_the_line() -> None:
    board = LineBoard(turnaround=0)
    async with connect(board, depth=16) as connected, connected.watch() as readings:
        reading = asyncio.create_task(read(readings, 20))
        loop = asyncio.get_running_loop()
        for number in range(10):
            await asyncio.sleep(1 + number / 100)
            begun = loop.time()
            await asyncio.gather(*(connected.project_id() for _ in range(5)))
            assert loop.time() - begun < 0.2
        await reading


# --- rates --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hz", [0.5, 3, 30])
async def test_a_rate_is_kept_on_average(hz: float) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        found = await read(board.watch(hz), 60)
        assert len(found) == pytest.approx(60 * hz + 1, abs=1)
        assert sum(reading.missed for reading in found) == 0
        assert len(queries(fake)) == len(found)


async def test_a_rate_that_the_board_does_not_keep_is_counted() -> None:
    fake = PipedBoard(usual=late(0.025))
    async with opened(fake) as board:
        found = await read(board.watch(100), 10)
        assert len(found) == pytest.approx(400, abs=3)
        assert len(found) + sum(reading.missed for reading in found) == pytest.approx(1000, abs=5)


async def test_a_program_that_is_too_slow_gets_the_latest_reading_and_the_number_of_the_others() -> None:
    fake = PipedBoard()
    async with opened(fake) as board, board.watch(100) as readings:
        loop = asyncio.get_running_loop()
        got = missed = 0
        for _ in range(20):
            await asyncio.sleep(0.095)
            reading = await anext(readings)
            assert loop.time() - reading.seconds < 0.011
            got += 1
            missed += reading.missed
        assert got + missed == pytest.approx(100 * 1.9, abs=3)


async def test_a_stall_of_the_program_is_no_reason_to_catch_up() -> None:
    fake = PipedBoard()
    async with opened(fake) as board, board.watch(100) as readings:
        await anext(readings)
        asyncio.get_running_loop().stall(1.0)  # type: ignore[attr-defined]
        before = len(queries(fake))
        reading = await anext(readings)
        while not reading.missed:
            reading = await anext(readings)
        assert reading.missed == pytest.approx(99, abs=2)
        await read(readings, 0.1)
        assert len(queries(fake)) - before < 15


async def test_several_readers_share_what_is_asked_and_each_has_its_rate() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        found = await asyncio.gather(*(read(board.watch(hz), 10) for hz in (10, 50, 30)))
        assert [len(each) for each in found] == pytest.approx([100, 500, 300], abs=3)
        assert sum(reading.missed for each in found for reading in each) == 0
        assert len(queries(fake)) == pytest.approx(500, abs=10)


async def test_the_fastest_reader_counts_also_if_it_comes_later_and_goes_earlier() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        slow = asyncio.create_task(read(board.watch(0.1), 60))
        await asyncio.sleep(22)
        assert len(queries(fake)) == 3
        assert len(await read(board.watch(), 1)) > 240
        asked = len(queries(fake))
        assert len(await slow) == pytest.approx(7, abs=1)
        assert len(queries(fake)) - asked < 10


@pytest.mark.parametrize(
    ("hz", "error", "message"),
    [
        (0, ValueError, "hz must be above 0 and at most 1000, not 0"),
        (1000.1, ValueError, "hz must be above 0 and at most 1000, not 1000.1"),
        (float("nan"), ValueError, "not nan"),
        ("fast", TypeError, "hz must be a number of readings per second or None, not 'fast'"),
        (True, TypeError, "not True"),
    ],
)
async def test_a_rate_that_is_none_is_refused(hz: float, error: type[Exception], message: str) -> None:
    async with opened(PipedBoard()) as board:
        with pytest.raises(error, match=message):
            board.watch(hz)


async def test_repr_shows_rate_and_state() -> None:
    async with opened(PipedBoard()) as board:
        readings = board.watch(50)
        assert repr(readings) == "<ServoReadings at 50 Hz, not begun>"
        async with readings:
            assert repr(readings) == "<ServoReadings at 50 Hz, reading>"
        assert repr(readings) == "<ServoReadings at 50 Hz, ended>"
        assert repr(board.watch()) == "<ServoReadings as fast as possible, not begun>"


# --- ends ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hz", [None, 20])
async def test_it_ends_when_the_board_is_closed(hz: float | None) -> None:
    async with opened(PipedBoard()) as board:
        reading = asyncio.create_task(read(board.watch(hz), 60))
        await asyncio.sleep(1)
        await board.close()
        assert len(await reading) >= 20
        with pytest.raises(ConnectionLost, match="closed by this program"):
            await anext(board.watch(hz))


@pytest.mark.parametrize("hz", [None, 20])
async def test_a_lost_connection_is_raised(hz: float | None) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        readings = board.watch(hz)
        await anext(readings)
        fake.vanish()
        for _ in range(2):
            with pytest.raises(ConnectionLost, match="device disconnected"):
                await read(readings, 1)
        with pytest.raises(ConnectionLost, match="device disconnected"):
            await anext(board.watch(hz))


@pytest.mark.parametrize("hz", [None, 20])
async def test_a_board_that_no_longer_answers_ends_it_and_it_can_be_begun_again(hz: float | None) -> None:
    fake = PipedBoard()
    async with opened(fake, patience=0.5) as board:
        readings = board.watch(hz)
        await anext(readings)
        fake.usual_of[QueryServoRequest] = LOST
        with pytest.raises(RequestTimeout):
            await read(readings, 5)
        fake.forget_plans()
        assert len(await read(board.watch(hz), 1)) >= 20


@pytest.mark.parametrize("hz", [None, 20])
@pytest.mark.parametrize(("depth", "lost_at"), [(1, 0.0), (1, 0.002), (1, 0.5), (8, 0.5)])
async def test_it_survives_a_reconnect(
    hz: float | None, depth: int, lost_at: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    fakes: list[PipedBoard] = []

    def create(_: object) -> PipedBoard:
        fakes.append(PipedBoard())
        return fakes[-1]

    monkeypatch.setattr(connecting, "create", create)
    async with connect("virtual://", reconnect=True, depth=depth) as board:
        loop = asyncio.get_running_loop()
        reading = asyncio.create_task(read(board.watch(hz), 4))
        await asyncio.sleep(lost_at)
        fakes[0].vanish()
        lost = loop.time()
        found = await reading
        assert [fake.gone is None for fake in fakes] == [False, True]
        after = [each.seconds - lost for each in found if each.seconds > lost]
        assert after[0] < 0.3
        assert len(after) >= 3 * 20


async def test_closing_during_a_reconnect_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    fakes: list[PipedBoard] = []

    def create(_: object) -> PipedBoard:
        fakes.append(PipedBoard(usual=Fate() if not fakes else LOST))
        return fakes[-1]

    monkeypatch.setattr(connecting, "create", create)
    board = await connect("virtual://", reconnect=True)
    reading = asyncio.create_task(read(board.watch(), 10))
    await asyncio.sleep(0.1)
    fakes[0].vanish()
    await asyncio.sleep(1)
    await board.close()
    assert len(await reading) > 20


async def test_who_reads_in_several_tasks_gets_each_reading_once() -> None:
    async with opened(PipedBoard()) as board, board.watch(100) as readings:
        found = await asyncio.gather(*(anext(readings) for _ in range(3)))
        assert len({reading.seconds for reading in found}) == 3


async def test_all_readers_end_with_the_program_that_forgets_them() -> None:
    """No task, timer or reader is left behind by a board that is closed while they are in use."""
    board = await connect(PipedBoard())
    readings = [board.watch(hz) for hz in (None, 5, 50)]
    await asyncio.gather(*(anext(each) for each in readings))
    await board.close()
    await asyncio.sleep(0)
    assert asyncio.all_tasks() == {asyncio.current_task()}
