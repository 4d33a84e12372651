"""Whoever is cancelled, at whatever moment, leaves nothing behind that disturbs others."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

import pytest

from servolink.client import Board, connect
from servolink.connection.connection import Connection
from servolink.connection.times import FIRST_TRY
from servolink.errors import ConnectionLost, OutcomeUnknown, RequestTimeout
from servolink.protocol import (
    AddActionRequest,
    AddActionResponse,
    ClearAllDataRequest,
    ExecuteActionRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoListRequest,
    SetServoParameterRequest,
    Step,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from servolink.testing import Fate
from tests.client.piped_board import LATENCY, LOST, PipedBoard, connected, late, now, turns_of_the_loop
from tests.virtual_time import run

# Every moment at which something happens while nothing is lost, and turns of the loop after it.
MOMENTS = [(number * LATENCY, turns) for number in range(5) for turns in range(8)]


async def cancelled_at(moment: float, turns: int, call: Coroutine[Any, Any, object]) -> bool:
    """Run `call`, cancel it that late, and tell whether it was still running."""
    task = asyncio.create_task(call)
    await asyncio.sleep(moment)
    await turns_of_the_loop(turns)
    running = not task.done()
    task.cancel()
    await asyncio.wait((task,))
    assert task.cancelled() == running
    return running


def is_idle(connection: Connection) -> bool:
    """Return whether no permit is taken and no response is expected."""
    scheduler = connection.scheduler
    idle = (scheduler._permits, scheduler._granted, len(scheduler.waiting)) == (0, [], 0)
    return idle and not connection.slots.live


async def assert_in_order(connection: Connection, board: PipedBoard) -> None:
    """Check that what is asked now is answered rightly and that no permit is lost."""
    begun = now()
    await connection.request(WriteProjectIDRequest(4711))
    assert (await connection.request(QueryProjectIDRequest())).project_id == 4711
    assert (await connection.request(ClearAllDataRequest())).result == 1  # goes alone, so no permit is taken any more
    assert (await connection.request(QueryServoListRequest())).servo_id_list == (1, 2, 3, 4)
    await connection.send(ExecuteActionRequest((Step(1, 5, 10),)))
    assert now() - begun < 3
    assert is_idle(connection)


CALLS: dict[str, Callable[[Connection], Awaitable[object]]] = {
    "query": lambda connection: connection.request(QueryProjectIDRequest()),
    "change": lambda connection: connection.request(WriteProjectIDRequest(5)),
    "clear": lambda connection: connection.request(ClearAllDataRequest()),
    "move": lambda connection: connection.send(ExecuteActionRequest((Step(1, 5, 10),))),
    "stop": lambda connection: connection.send_stop(SetServoParameterRequest(255, 0, 1)),
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize(("depth", "done_at_once"), [(1, {"stop"}), (3, {"stop", "move"})])
def test_cancelled_at_any_moment(name: str, depth: int, done_at_once: set[str]) -> None:
    async def main(moment: tuple[float, int]) -> bool:
        board = PipedBoard()
        async with connected(board, depth=depth) as connection:
            before = asyncio.create_task(connection.request(QueryMemorySizeRequest()))
            running = await cancelled_at(*moment, coroutine(CALLS[name](connection)))
            await before
            await assert_in_order(connection, board)
            return running

    interrupted = {run(main(moment)) for moment in MOMENTS}
    assert interrupted == ({False} if name in done_at_once else {True, False})


@pytest.mark.parametrize("name", CALLS)
def test_cancelled_at_any_moment_while_the_line_takes_no_bytes(name: str) -> None:
    async def main(moment: tuple[float, int]) -> bool:
        board = PipedBoard()
        async with connected(board) as connection:
            board.taking = asyncio.Event()
            asyncio.get_running_loop().call_later(2 * LATENCY, board.taking.set)
            running = await cancelled_at(*moment, coroutine(CALLS[name](connection)))
            board.taking = None
            await assert_in_order(connection, board)
            return running

    assert {run(main(moment)) for moment in MOMENTS} == {True, False}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("fate", [LOST, late(1.2)])
def test_cancelled_at_any_moment_while_a_fence_is_needed_and_answered_late(name: str, fate: Fate) -> None:
    async def main(moment: tuple[float, int]) -> bool:
        board = PipedBoard()
        for kind in (QueryProjectIDRequest, WriteProjectIDRequest, ClearAllDataRequest):
            board.plan(kind, fate)
        async with connected(board) as connection:
            with pytest.raises(OutcomeUnknown):
                await connection.request(ClearAllDataRequest(), timeout=0.1)
            board.executed.clear()
            running = await cancelled_at(*moment, coroutine(CALLS[name](connection)))
            await asyncio.sleep(3)
            board.forget_plans()
            await assert_in_order(connection, board)
            return running

    moments = [(halves / 2, turns) for halves in range(9) for turns in (0, 2, 5, 9)]
    assert {run(main(moment)) for moment in moments} == ({False} if name == "stop" else {True, False})


async def coroutine(call: Awaitable[object]) -> object:
    return await call


async def test_who_is_cancelled_as_the_answer_comes_gets_the_cancellation_and_the_lane_is_clean() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        task = asyncio.create_task(connection.request(QueryServoListRequest()))
        await turns_of_the_loop(3)
        asyncio.get_running_loop().call_later(LATENCY, task.cancel)
        await asyncio.wait((task,))
        assert task.cancelled()
        await connection.request(QueryServoListRequest())
        assert connection.stats.fences == 0


async def test_the_answer_to_a_cancelled_request_is_never_given_to_the_next() -> None:
    board = PipedBoard()
    board.plan(AddActionRequest, Fate(delay=0.5, says=AddActionResponse(0)))
    async with connected(board) as connection:
        await cancelled_at(0.1, 0, connection.request(AddActionRequest(1, "a")))
        assert (await connection.request(AddActionRequest(2, "b"))).result == 1


@pytest.mark.parametrize("after", [0.5, 1.5, 2.5])
async def test_the_late_answer_to_a_cancelled_request_is_never_given_to_the_next(after: float) -> None:
    board = PipedBoard()
    board.plan(WriteProjectIDRequest, Fate(delay=after, says=WriteProjectIDResponse(0)))
    async with connected(board) as connection:
        await cancelled_at(0.1, 0, connection.request(WriteProjectIDRequest(1)))
        assert (await connection.request(WriteProjectIDRequest(2))).result == 1


async def test_a_cancelled_fence_ends_by_itself_and_still_proves_something() -> None:
    board = PipedBoard()
    board.plan(AddActionRequest, LOST)
    async with connected(board) as connection:
        with pytest.raises(OutcomeUnknown):
            await connection.request(AddActionRequest(1), timeout=0.1)
        await cancelled_at(0, 3, connection.request(AddActionRequest(1)))
        await asyncio.sleep(1)
        assert (await connection.request(AddActionRequest(1))).result == 1
        assert connection.stats.fences == 1
        assert len(board.executed_of(AddActionRequest)) == 1


async def test_a_cancelled_request_that_is_never_answered_gives_its_permit_back_at_its_deadline() -> None:
    board = PipedBoard()
    board.plan(QueryServoListRequest, LOST)
    async with connected(board) as connection:
        begun = now()
        await cancelled_at(0.1, 0, connection.request(QueryServoListRequest()))
        await connection.request(QueryProjectIDRequest())
        assert now() == pytest.approx(begun + FIRST_TRY + LATENCY)


async def test_the_end_of_the_link_finds_a_cancelled_request() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board) as connection:
        await cancelled_at(0.1, 0, connection.request(QueryServoListRequest()))
        waiting = asyncio.create_task(connection.request(QueryProjectIDRequest()))
        await turns_of_the_loop(2)
        board.vanish()
        with pytest.raises(ConnectionLost):
            await waiting


async def test_a_time_limit_of_the_caller_is_a_cancellation_like_any_other() -> None:
    board = PipedBoard()
    board.plan(QueryProjectIDRequest, Fate(delay=0.5, says=QueryProjectIDResponse(1)))
    async with connected(board) as connection:
        with pytest.raises(TimeoutError) as caught:
            async with asyncio.timeout(0.1):
                await connection.request(QueryProjectIDRequest())
        assert not isinstance(caught.value, RequestTimeout)
        assert (await connection.request(QueryProjectIDRequest())).project_id == 0


BOARD_CALLS: dict[str, Callable[[Board], Awaitable[object]]] = {
    "servos": lambda board: board.servos(),
    "move by speed": lambda board: board.move({1: 90, 2: 45}, speed=90),
    "move and wait": lambda board: board.move({1: 90}, duration=0.02, wait=True),
    "set_servo": lambda board: board.set_servo(1, start=True, hold=True),
    "stop": lambda board: board.stop(),
    "events": lambda board: board.button_events().__aenter__(),
}


@pytest.mark.parametrize("name", BOARD_CALLS)
def test_calls_of_several_requests_cancelled_at_any_moment(name: str) -> None:
    async def main(moment: tuple[float, int]) -> bool:
        board = PipedBoard()
        async with connect(board) as servo_board:
            running = await cancelled_at(*moment, coroutine(BOARD_CALLS[name](servo_board)))
            await asyncio.sleep(0.1)
            await servo_board.set_servo(255, start=True, hold=True)
            await servo_board.move({2: 10}, duration=0.1)
            await asyncio.sleep(0.2)
            assert (await servo_board.servo(2)).angle == 10
            assert is_idle(servo_board.connection)
            return running

    moments = [(number * LATENCY, turns) for number in range(12) for turns in range(0, 12, 2)]
    assert {run(main(moment)) for moment in moments} == {True, False}
