"""What waits while the computer sleeps moves nothing afterwards.

Module: servolink.support.platforms.timers.
"""

from __future__ import annotations

import asyncio

import pytest

from servolink.errors import RequestError, RequestRefused
from servolink.protocol import AddActionRequest, ExecuteActionRequest, QueryServoListRequest, Step
from servolink.support import SleepCounter, seconds_asleep, time_with_sleep
from tests.client.piped_board import PipedBoard, connected, late, now, opened
from tests.support.sleeping import HOUR, Computer, computer

__all__ = ["computer"]

MOVE = ExecuteActionRequest((Step(1, 5, 10),))


async def test_deadlines_count_the_time_asleep(computer: Computer) -> None:
    before, asleep = time_with_sleep(), seconds_asleep()
    computer.sleep()
    assert time_with_sleep() - before == HOUR
    assert seconds_asleep() - asleep == HOUR


def test_a_sleep_is_counted_once_and_two_clocks_that_differ_a_little_are_none(computer: Computer) -> None:
    counter = SleepCounter()
    computer.sleep(0.5)
    assert counter() == 0
    computer.sleep()
    assert [counter(), counter()] == [1, 1]


def test_a_program_that_is_not_run_between_two_readings_has_not_slept(computer: Computer) -> None:
    counter, asleep = SleepCounter(), seconds_asleep()
    computer.pauses = [2.0, 0.0, 0.0]
    assert counter() == 0
    computer.pauses = [2.0, 0.0, 0.0] * 5  # the one after the other: the difference is as good as it gets
    assert seconds_asleep() - asleep == 2


async def test_motions_that_wait_while_the_computer_sleeps_are_not_sent(computer: Computer) -> None:
    board = PipedBoard(usual=late(0.1))
    async with connected(board) as connection:
        busy = asyncio.create_task(connection.request(AddActionRequest(1)))
        await asyncio.sleep(0.05)
        moving = asyncio.create_task(connection.send(MOVE))
        asking = asyncio.create_task(connection.request(QueryServoListRequest()))
        await asyncio.sleep(0)
        computer.sleep()
        with pytest.raises(RequestError, match="was not sent: this computer has slept since it was asked for"):
            await moving
        await busy
        await asking  # a query moves nothing
        assert board.executed_of(ExecuteActionRequest) == []
        await connection.send(MOVE)
        assert board.executed_of(ExecuteActionRequest) == [MOVE]


async def test_the_deadline_of_a_motion_passes_during_sleep(computer: Computer) -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        computer.sleep()
        ticket = connection.stops.ticket(until=now() + 12.0 + HOUR / 2)
        with pytest.raises(RequestError, match="the time by which it was to begin has passed"):
            await connection.send(MOVE, ticket=ticket)
        assert board.executed_of(ExecuteActionRequest) == []


async def test_a_movement_asked_for_after_a_sleep_is_sent(computer: Computer) -> None:
    async with opened(fake := PipedBoard(), angle_unit=None) as board:
        moving = asyncio.create_task(board.move({1: 30}, duration=2.0, wait=True))
        await asyncio.sleep(0.5)
        computer.sleep()
        later = asyncio.create_task(board.move({1: 60}, duration=2.0))
        await asyncio.gather(moving, later, return_exceptions=True)
        assert later.exception() is None
        assert len(fake.executed_of(ExecuteActionRequest)) == 2


async def test_a_stream_of_set_points_ends_with_a_sleep(computer: Computer) -> None:
    async with opened(fake := PipedBoard()) as board:
        stream = board.stream(50, gap=0.5)
        assert await stream.send({1: 30}) == {1: 30}
        computer.sleep()
        with pytest.raises(RequestRefused, match="the stream has ended"):
            await stream.send({1: 60})
        assert len(fake.executed_of(ExecuteActionRequest)) == 1
