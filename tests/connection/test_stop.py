"""A stop goes before everything, whatever state the line is in, and its response proves nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from servolink.connection.connection import Connection
from servolink.connection.fences import FENCES
from servolink.errors import ConnectionLost, OutcomeUnknown, RequestError
from servolink.protocol import (
    ALL_SERVOS,
    AddActionRequest,
    ClearAllDataRequest,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    QueryProjectIDRequest,
    QueryServoListRequest,
    QueryServoRequest,
    SetServoParameterRequest,
    SetServoParameterResponse,
    Step,
)
from servolink.testing import Fate
from tests.client.piped_board import LATENCY, LOST, SWALLOWED, PipedBoard, connected, late, lie, now, turns_of_the_loop

STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)
START = SetServoParameterRequest(ALL_SERVOS, 1, 1)
LIST = QueryServoListRequest()
MOVE = ExecuteActionRequest((Step(1, 5, 10),))


# --- at once ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("depth", [1, 8])
async def test_it_goes_before_all_who_wait(depth: int) -> None:
    board = PipedBoard(usual=late(0.1))
    async with connected(board, depth=depth) as connection:
        waiting = [asyncio.create_task(connection.request(AddActionRequest(number))) for number in range(40)]
        await asyncio.sleep(0.05)
        sent, begun = len(board.sent), now()
        await connection.send_stop(STOP)
        assert now() == begun
        assert board.sent[sent:] == [(begun, STOP)]
        await asyncio.gather(*waiting)


async def test_it_goes_while_deleting_everything_goes_alone() -> None:
    board = PipedBoard()
    board.plan(ClearAllDataRequest, late(5))
    async with connected(board, depth=4) as connection:
        clearing = asyncio.create_task(connection.request(ClearAllDataRequest()))
        await asyncio.sleep(0.1)
        begun = now()
        await connection.send_stop(STOP)
        assert board.sent[-1] == (begun, STOP)
        assert (await clearing).result == 1


async def test_it_goes_to_a_board_that_answers_nothing() -> None:
    board = PipedBoard(usual=SWALLOWED)
    async with connected(board) as connection:
        asking = asyncio.create_task(connection.request(LIST))
        for _ in range(5):
            await asyncio.sleep(0.5)
            begun = now()
            await connection.send_stop(STOP)
            assert board.sent[-1] == (begun, STOP)
        asking.cancel()
        assert board.executed_of(SetServoParameterRequest) == [STOP] * 5


async def test_it_is_confirmed_by_what_is_read_back_before_all_who_wait() -> None:
    board = PipedBoard(usual=late(0.05))
    async with connected(board) as connection:
        waiting = [asyncio.create_task(connection.request(LIST)) for _ in range(20)]
        await asyncio.sleep(0.01)
        await connection.send_stop(STOP)
        states = await connection.request(QueryServoRequest(ALL_SERVOS), first=True)
        assert {state.is_start for state in states.servos} == {0}
        assert [type(packet) for _, packet in board.sent[:3]] == [
            QueryServoListRequest,
            SetServoParameterRequest,
            QueryServoRequest,
        ]
        await asyncio.gather(*waiting)


async def test_on_a_lost_connection_it_says_so() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        board.vanish()
        with pytest.raises(ConnectionLost, match="device disconnected"):
            await connection.send_stop(STOP)


# --- what it overtakes --------------------------------------------------------------------------------------------

MOVEMENTS: dict[str, Callable[[Connection], Awaitable[object]]] = {
    "move": lambda connection: connection.send(MOVE),
    "stored action": lambda connection: connection.send(ExecuteActionExRequest(1)),
    "macro": lambda connection: connection.request(ExecuteMacroRequest(1)),
    "start": lambda connection: connection.request(START),
}


@pytest.mark.parametrize("name", MOVEMENTS)
async def test_a_movement_that_was_asked_for_before_it_is_not_sent_after_it(name: str) -> None:
    board = PipedBoard()
    board.plan(ClearAllDataRequest, late(0.5))
    async with connected(board) as connection:
        clearing = asyncio.create_task(connection.request(ClearAllDataRequest()))
        await turns_of_the_loop(3)
        moving = asyncio.ensure_future(MOVEMENTS[name](connection))
        await turns_of_the_loop(3)
        await connection.send_stop(STOP)
        with pytest.raises(RequestError, match="was not sent: a stop came first"):
            await moving
        await clearing
        assert not [packet for _, packet in board.sent if packet not in {ClearAllDataRequest(), STOP, *FENCES}]
        await MOVEMENTS[name](connection)


async def test_releasing_servos_is_no_movement() -> None:
    board = PipedBoard()
    board.plan(ClearAllDataRequest, late(0.5))
    async with connected(board) as connection:
        clearing = asyncio.create_task(connection.request(ClearAllDataRequest()))
        await turns_of_the_loop(3)
        releasing = asyncio.create_task(connection.request(SetServoParameterRequest(1, 0, 0)))
        await turns_of_the_loop(3)
        await connection.send_stop(STOP)
        cleared, released = await asyncio.gather(clearing, releasing)
        assert (cleared.result, released.is_start, released.is_hold) == (1, 0, 0)


async def test_a_movement_can_be_made_to_depend_on_the_stops_since_another_moment() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        ticket = connection.stops.ticket()
        assert await connection.send(MOVE, ticket=ticket)
        await connection.send_stop(STOP)
        with pytest.raises(RequestError, match="a stop came first"):
            await connection.send(MOVE, ticket=ticket)
        assert await connection.send(MOVE, ticket=connection.stops.ticket())


async def test_what_waits_for_a_response_of_that_kind_is_told_that_it_cannot_be_known() -> None:
    board = PipedBoard()
    board.plan(SetServoParameterRequest, late(0.5))
    async with connected(board) as connection:
        waiting = asyncio.create_task(connection.request(SetServoParameterRequest(1, 1, 1)))
        await asyncio.sleep(0.1)
        begun = now()
        await connection.send_stop(STOP)
        with pytest.raises(OutcomeUnknown, match="overtaken by a stop"):
            await waiting
        assert now() == begun
        assert (await connection.request(START)).is_start == 1


async def test_the_permit_of_one_who_was_cancelled_on_that_lane_is_given_back() -> None:
    board = PipedBoard()
    board.plan(SetServoParameterRequest, LOST)
    async with connected(board) as connection:
        waiting = asyncio.create_task(connection.request(SetServoParameterRequest(1, 1, 1)))
        await asyncio.sleep(0.1)
        waiting.cancel()
        await turns_of_the_loop(2)
        await connection.send_stop(STOP)
        begun = now()
        await connection.request(LIST)
        assert now() == pytest.approx(begun + 2 * LATENCY)  # a fence comes first


# --- its response -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", [0, 1])
async def test_the_response_to_what_it_overtook_is_not_taken_for_one_to_what_follows(start: int) -> None:
    board = PipedBoard()
    board.plan(SetServoParameterRequest, Fate(delay=1.5), Fate(delay=3.0))
    async with connected(board) as connection:
        waiting = asyncio.create_task(connection.request(SetServoParameterRequest(ALL_SERVOS, start, 1)))
        await asyncio.sleep(0.1)
        await connection.send_stop(STOP)
        with pytest.raises(OutcomeUnknown, match="was overtaken by a stop"):
            await waiting
        await asyncio.sleep(2.4)
        following = SetServoParameterRequest(ALL_SERVOS, 1, 0)
        assert (await connection.request(following)).is_start == 1  # and not that to the stop, which comes at 3.1
        assert connection.stats.fences >= 1


async def test_its_response_is_no_proof() -> None:
    """An older request may still be answered: the stop may have overtaken it inside the board."""
    board = PipedBoard()
    board.plan(QueryServoListRequest, SWALLOWED)
    async with connected(board, depth=2) as connection:
        asking = asyncio.create_task(connection.request(LIST))
        await turns_of_the_loop(3)
        await connection.send_stop(STOP)
        await asyncio.sleep(0.1)
        assert connection.stats.frames_received == 1
        assert len(board.sent_of(QueryServoListRequest)) == 1  # nothing was proved lost
        await asking


async def test_after_any_later_response_its_lane_is_used_as_ever() -> None:
    board = PipedBoard()
    board.plan(SetServoParameterRequest, LOST)
    async with connected(board) as connection:
        await connection.send_stop(STOP)
        await connection.request(QueryProjectIDRequest())
        board.plan(SetServoParameterRequest, lie(SetServoParameterResponse(ALL_SERVOS, 1, 1)))
        assert (await connection.request(START)).is_start == 1
        assert connection.stats.fences == 0


async def test_many_stops_are_settled_together() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        for _ in range(50):
            await connection.send_stop(STOP)
        assert connection.stops.count == 50
        assert (await connection.request(START)).is_start == 1
        assert connection.slots.overdue == 0
