"""Board.stream: set-points from a gamepad, a policy or a dance."""

from __future__ import annotations

import asyncio
import math
from itertools import pairwise
from typing import Any

import pytest

from servolink.client.board import Board
from servolink.client.servo_stream import ServoStream
from servolink.connection import FENCES
from servolink.errors import ConnectionLost, EncodeError, MotionRefused, NotFound, RequestError
from servolink.motion import Adc, Degrees
from servolink.protocol import (
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoParameterRequest,
    QueryServoRequest,
    ServoParameter,
    SetServoParameterRequest,
    Step,
)
from tests.client.line_board import LineBoard
from tests.client.piped_board import LOST, PipedBoard, late, now, opened


def movements(fake: PipedBoard) -> list[tuple[Step, ...]]:
    """Return the movements that the board got."""
    return [
        packet.steps for packet in fake.executed_of(ExecuteActionRequest) if isinstance(packet, ExecuteActionRequest)
    ]


async def at_zero(fake: PipedBoard, board: Board) -> None:
    """Let all servos stand at 0 degrees."""
    for servo in fake.servos.values():
        servo.angle = 0.0


async def flood(stream: ServoStream, seconds: float, angle: float = 90.0, servos: int = 1) -> int:
    """Give the same set-point as often as it is taken, and return how many were sent."""
    count, end = 0, now() + seconds
    while now() < end:
        count += bool(await stream.send(dict.fromkeys(range(1, servos + 1), angle)))
    return count


# --- limits -------------------------------------------------------------------------------------------------------


async def test_an_angle_beyond_a_limit_becomes_the_limit_and_what_was_sent_is_returned() -> None:
    fake = PipedBoard()
    async with opened(fake, angle_limits={1: (-80, 80)}) as board:
        stream = board.stream(hz=50)
        assert await stream.send({1: 300.0, 2: 30.4}) == {1: 80, 2: 30}
        sent = await stream.send({1: -300, 2: -30.6})
        assert sent == {1: -80, 2: -31}
        assert type(sent[1]) is Degrees
    assert movements(fake) == [(Step(1, 80, 2), Step(2, 30, 2)), (Step(1, -80, 2), Step(2, -31, 2))]
    assert len(fake.sent_of(QueryServoRequest)) == 1  # before the first movement; without a cap never again


async def test_a_servo_turns_no_faster_than_its_cap_whatever_is_streamed() -> None:
    fake = PipedBoard()
    async with opened(fake, speed_cap=100) as board:
        await at_zero(fake, board)
        stream, angles, begun = board.stream(hz=50), [0.0], now()
        for number in range(200):
            await stream.send({1: 90 if number // 40 % 2 else -90})
            fake.advance(now())
            angles.append(fake.servos[1].angle)
        seconds = (now() - begun) / 200
        fastest = max(abs(one - other) for one, other in pairwise(angles)) / seconds
    assert seconds == pytest.approx(0.02, rel=0.02)
    assert 80 < fastest <= 105
    assert len(fake.sent_of(QueryServoRequest)) == 1


async def test_a_servo_outside_its_limits_comes_back_slowly_and_never_goes_farther() -> None:
    fake = PipedBoard()
    async with opened(fake, angle_limits=(-90, 90), speed_cap=200) as board:
        fake.servos[1].angle = 170.0
        stream = board.stream(hz=50)
        sent = [(await stream.send({1: 175}))[1] for _ in range(40)]
    assert sent == sorted(sent, reverse=True)
    assert sent[0] == 170 - 14
    assert sent[-1] == 90


async def test_the_first_set_point_is_approached_no_faster_than_the_soft_start() -> None:
    fake = PipedBoard()
    async with opened(fake, soft_start=20) as board:
        await at_zero(fake, board)
        stream, begun = board.stream(hz=50), now()
        while (await stream.send({1: 10}))[1] < 10:
            pass
        assert now() - begun == pytest.approx(0.5, abs=0.15)
        assert await stream.send({1: 60}) == {1: 60}
        assert await board.move({1: 0}, duration=0.5) == 0.5  # nor is the next movement soft


@pytest.mark.parametrize("wrong", [math.nan, math.inf, "45", Adc(100)])
async def test_what_is_no_angle_is_refused_and_the_stream_goes_on(wrong: Any) -> None:
    fake = PipedBoard()
    async with opened(fake, angle_limits=(-80, 80)) as board:
        stream = board.stream()
        with pytest.raises(EncodeError, match="servo 1: a set-point must be a finite angle in degrees"):
            await stream.send({2: 5, 1: wrong})
        assert movements(fake) == []
        assert await stream.send({2: 5}) == {2: 5}


async def test_unknown_servos_are_refused_and_captions_are_read_once() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.add_servo_parameters([ServoParameter(3, 0, "hip")])
        stream = board.stream()
        with pytest.raises(NotFound, match="no servo 9"):
            await stream.send({1: 5, 9: 5})
        with pytest.raises(NotFound, match="hop"):
            await stream.send({"hop": 5})
        with pytest.raises(TypeError, match="must map servos to angles"):
            await stream.send([1, 2])  # type: ignore[arg-type]
        for angle in range(5):
            assert await stream.send({"hip": angle}) == {3: angle}
        assert await stream.send({"all": 7}) == {1: 7, 2: 7, 3: 7, 4: 7}
    assert len(fake.sent_of(QueryServoParameterRequest)) == 2
    assert len(movements(fake)) == 6


async def test_a_servo_set_to_raw_angles_is_refused() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.set_angle_unit("adc", 2)
        with pytest.raises(MotionRefused, match="servo 2 must be set to degrees"):
            await board.stream().send({1: 5, 2: 5})
        assert movements(fake) == []


async def test_an_angle_that_the_protocol_cannot_hold_is_refused() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        with pytest.raises(EncodeError, match="40000"):
            await board.stream().send({1: 40_000.0})


@pytest.mark.parametrize(
    ("hz", "gap", "text"),
    [(0, 0.5, "hz must be"), (101, 0.5, "hz must be"), (math.nan, 0.5, "hz"), (50, 0.02, "gap"), (50, 11, "gap")],
)
async def test_an_impossible_rate_or_gap_is_refused_at_once(hz: float, gap: float, text: str) -> None:
    async with opened(PipedBoard()) as board:
        with pytest.raises(ValueError, match=text):
            board.stream(hz, gap=gap)
        with pytest.raises(TypeError, match="must be a number"):
            board.stream("50")  # type: ignore[arg-type]


# --- time ---------------------------------------------------------------------------------------------------------


async def test_set_points_leave_at_the_rate_asked_for_and_no_faster() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        for hz in (100, 20):
            stream, times = board.stream(hz=hz), []
            for angle in range(hz):
                assert await stream.send({1: angle}) == {1: angle}
                times.append(now())
            # The clock of sleeps is read beside that of the loop, which takes some time.
            assert [after - before for before, after in pairwise(times)] == pytest.approx([1 / hz] * (hz - 1), abs=1e-3)
    assert len(fake.sent_of(QueryServoListRequest)) == 1


async def test_the_latest_set_point_wins_and_those_before_it_are_dropped() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        stream = board.stream(hz=10)
        await stream.send({1: 0})
        sent = await asyncio.gather(*(stream.send({1: angle}) for angle in range(1, 9)))
    assert sent == [{}] * 7 + [{1: 8}]
    assert movements(fake) == [(Step(1, 0, 10),), (Step(1, 8, 10),)]


async def test_while_the_board_does_not_keep_up_only_the_latest_waits() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        stream = board.stream(hz=100)
        await stream.send({1: 0})
        for fence in FENCES:
            fake.usual_of[type(fence)] = late(0.1)
        tasks = []
        for angle in range(1, 61):
            tasks.append(asyncio.create_task(stream.send({1: angle})))
            await asyncio.sleep(0.01)
        sent = [found for task in tasks if (found := await task)]
    assert 16 <= len(sent) <= 45  # a few for each proof, and not all 60
    assert sent[-1] == {1: 60}


async def test_a_gap_ends_the_stream_and_the_servos_keep_their_last_target() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        stream = board.stream()
        await stream.send({1: 5})
        await asyncio.sleep(0.45)
        await stream.send({1: 6})
        await asyncio.sleep(0.55)
        with pytest.raises(RequestError, match="no set-point was given for more than"):
            await stream.send({1: 7})
        await asyncio.sleep(1)
        assert (await board.servo(1)).angle == 6
        assert await board.stream(gap=2).send({1: 7}) == {1: 7}


async def test_a_set_point_that_waits_longer_than_the_gap_is_not_sent() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        stream = board.stream()
        await stream.send({1: 1})
        fake.taking = asyncio.Event()
        blocked = asyncio.create_task(stream.send({1: 2}))
        await asyncio.sleep(0.1)
        late_one = asyncio.create_task(stream.send({1: 3}))
        await asyncio.sleep(0.6)
        fake.taking.set()
        assert await blocked == {1: 2}
        with pytest.raises(RequestError, match="the time by which it was to begin has passed"):
            await late_one
    assert len(movements(fake)) == 2


async def test_another_motion_and_a_pause_of_half_a_second_are_followed_by_a_reading() -> None:
    fake = PipedBoard()
    async with opened(fake, speed_cap=100) as board:
        await at_zero(fake, board)
        stream = board.stream(gap=2)
        await stream.send({1: 1})
        await board.move({1: 50}, duration=1, wait=True)
        read = len(fake.sent_of(QueryServoRequest))
        assert await stream.send({1: 90}) == {1: 57}
        await asyncio.sleep(0.6)
        fake.advance(now())
        fake.servos[1].angle = 20.0  # somebody turns it
        assert (await stream.send({1: 90}))[1] < 57
        assert len(fake.sent_of(QueryServoRequest)) == read + 2
        await board.set_servo(1, start=False, hold=True)
        await board.set_servo(1, start=True, hold=True)
        await stream.send({1: 90})
        assert len(fake.sent_of(QueryServoRequest)) == read + 3


# --- ends ---------------------------------------------------------------------------------------------------------


async def test_a_stop_ends_the_stream_also_for_a_set_point_that_waits() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        stream = board.stream(hz=10)
        await stream.send({1: 5})
        waiting = asyncio.create_task(stream.send({1: 50}))
        await asyncio.sleep(0)
        await board.stop()
        with pytest.raises(RequestError, match="ended by a stop"):
            await waiting
        await board.set_servo(1, start=True, hold=True)
        with pytest.raises(RequestError, match="ended by a stop"):
            await stream.send({1: 50})
        assert len(movements(fake)) == 1
        assert await board.stream().send({1: 50}) == {1: 50}


async def test_a_stream_that_was_made_before_a_stop_never_begins() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        stream = board.stream()
        await board.stop()
        with pytest.raises(RequestError, match="ended by a stop"):
            await stream.send({1: 50})
    assert movements(fake) == []


async def test_a_slow_board_is_prepared_before_the_first_set_point_which_is_not_late_then() -> None:
    fake = PipedBoard(usual=late(0.3))
    async with opened(fake, speed_cap=100) as board:
        assert await board.stream().send({1: 0})


async def test_a_lost_connection_ends_the_stream() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        stream = board.stream()
        await stream.send({1: 5})
        fake.vanish()
        with pytest.raises(ConnectionLost):
            await stream.send({1: 6})


async def test_a_lost_reading_is_asked_for_again_and_a_cancelled_set_point_is_not_sent() -> None:
    fake = PipedBoard()
    fake.plan(QueryServoRequest, LOST)
    async with opened(fake, speed_cap=100) as board:
        stream = board.stream(gap=1)
        assert await stream.send({1: 0})
        task = asyncio.create_task(stream.send({1: 90}))
        await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        assert await stream.send({1: 0})
    assert all(steps[0].degree < 90 for steps in movements(fake))


# --- a slow line --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("servos", "least"), [(1, 99), (8, 99), (16, 70)])
async def test_the_rate_falls_to_that_of_the_line(servos: int, least: int) -> None:
    fake = LineBoard(servos=16)
    async with opened(fake) as board:
        stream = board.stream(hz=100)
        count = await flood(stream, 2.0, servos=servos) / 2
        assert least <= count <= 101
        begun = now()
        await board.stop()
    stop = fake.executed_of(SetServoParameterRequest)[-1]
    arrived = next(at for at, packet in fake.executed if packet is stop)
    assert arrived - begun < 0.05
    assert fake.overflows == 0
    assert len(fake.sent_of(QueryServoListRequest)) == 1
