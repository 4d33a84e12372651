"""A query that the board does not know lets other requests be sent between its tries.

Module: servolink.connection.sender.
"""

from __future__ import annotations

import asyncio
from itertools import pairwise

import pytest

from servolink.connection.connection import Connection
from servolink.connection.scheduler import MOST_ASIDE
from servolink.connection.sender import RequestSender
from servolink.errors import ConnectionLost, RequestTimeout
from servolink.protocol import (
    ClearAllDataRequest,
    ExecuteActionRequest,
    Packet,
    QueryActionRequest,
    QueryProjectIDRequest,
    QueryServoListRequest,
    QueryServoListResponse,
    Step,
)
from tests.client.piped_board import LATENCY, LOST, PipedBoard, connected, late, now
from tests.connection.unanswered import FENCE_KINDS, LIST, PROJECT, ask_for_ever

UNKNOWN = QueryActionRequest(7)
MOVE = ExecuteActionRequest((Step(1, 30, 100),))


def deaf_board() -> PipedBoard:
    """Return a board that does not know one kind of query."""
    board = PipedBoard()
    board.usual_of[QueryActionRequest] = LOST
    return board


async def until_aside(connection: Connection) -> None:
    """Wait until a call has stepped aside."""
    while connection.callers == 1:
        await asyncio.sleep(0.001)


@pytest.mark.parametrize("depth", [1, 2])
async def test_others_are_answered_between_its_tries(depth: int) -> None:
    board = deaf_board()
    async with connected(board, depth=depth) as connection:
        await connection.request(PROJECT)
        begun = now()
        others = [asyncio.create_task(ask_for_ever(connection, LIST)) for _ in range(depth)]
        with pytest.raises(RequestTimeout, match="the board answers other requests"):
            await connection.request(UNKNOWN)
        assert now() == pytest.approx(begun + 3, abs=0.3)
        for other in others:
            other.cancel()
        await asyncio.wait(others)
        lists = board.sent_of(QueryServoListRequest)
        assert max(after - before for before, after in pairwise([begun, *lists])) < 0.8
        assert len(lists) * LATENCY > 1.5, "half of the time is theirs"


async def test_nothing_is_sent_beside_it_that_the_board_could_miss() -> None:
    """At depth 1 a fence is answered behind each of its sendings before anything else is sent."""
    board = deaf_board()
    async with connected(board) as connection:
        asking = asyncio.create_task(connection.request(UNKNOWN))
        while not asking.done():
            await connection.send(MOVE)
            await connection.request(LIST)
        assert isinstance(asking.exception(), RequestTimeout)
    sent = [packet for _, packet in board.sent]
    tries = [at for at, packet in enumerate(sent) if packet == UNKNOWN]
    assert len(tries) >= 6
    assert all(sent[at + 1] == UNKNOWN or isinstance(sent[at + 1], FENCE_KINDS) for at in tries[:-1])


async def test_a_board_that_is_only_slow_gets_nothing_else_meanwhile() -> None:
    board = PipedBoard()
    board.plan(QueryActionRequest, late(1.5))
    async with connected(board) as connection:
        await connection.request(PROJECT)
        asking = asyncio.create_task(connection.request(UNKNOWN))
        await asyncio.sleep(0)
        await connection.send(MOVE)
        assert asking.done()
        assert board.sent_of(ExecuteActionRequest)[0] >= board.answered_at[1] - 0.001


async def test_a_board_that_learns_to_answer_is_heard() -> None:
    board = deaf_board()
    async with connected(board) as connection:
        asking = asyncio.create_task(connection.request(UNKNOWN))
        await until_aside(connection)
        board.forget_plans()
        begun = now()
        await asking
        assert now() < begun + 0.5


@pytest.mark.parametrize("seconds", [0.0, 0.02, 0.2, 0.5, 1.0])
async def test_who_is_cancelled_leaves_its_place(seconds: float) -> None:
    board = deaf_board()
    async with connected(board) as connection:
        other = asyncio.create_task(ask_for_ever(connection, LIST))
        asking = asyncio.create_task(connection.request(UNKNOWN))
        await until_aside(connection)
        await asyncio.sleep(seconds)
        asking.cancel()
        await asyncio.wait((asking,))
        begun, before = now(), len(board.sent)
        await connection.request(PROJECT)
        assert now() < begun + 0.3
        await asyncio.sleep(1)
        assert len(board.sent) > before + 200, "one after the other"
        assert (connection.callers, connection.has_waiting) == (1, False)
        other.cancel()
        await asyncio.wait((other,))


@pytest.mark.parametrize("timeout", [0.8, 1.0, 1.2, 2.0])
async def test_its_timeout_counts_while_it_pauses_and_while_it_waits_for_its_turn(timeout: float) -> None:
    board = deaf_board()
    async with connected(board) as connection:
        await connection.request(PROJECT)
        begun = now()
        asking = asyncio.create_task(connection.request(UNKNOWN, timeout=timeout))
        await until_aside(connection)
        board.plan(QueryServoListRequest, late(5.0))
        other = asyncio.create_task(connection.request(LIST))
        with pytest.raises(RequestTimeout):
            await asking
        assert now() == pytest.approx(begun + timeout)
        with pytest.raises(RequestTimeout):
            await other
        await asyncio.sleep(5)
        await connection.request(PROJECT)
        assert connection.callers == 1


async def test_its_patience_counts_while_it_waits_for_its_turn() -> None:
    board = deaf_board()
    async with connected(board) as connection:
        await connection.request(PROJECT)
        begun = now()
        asking = asyncio.create_task(connection.request(UNKNOWN))
        await until_aside(connection)
        board.plan(ClearAllDataRequest, late(20.0))
        erasing = asyncio.create_task(connection.request(ClearAllDataRequest()))
        with pytest.raises(RequestTimeout):
            await asking
        assert now() == pytest.approx(begun + connection.patience)
        assert not erasing.done()
        await erasing
        assert (connection.callers, connection.has_waiting) == (1, False)


async def test_it_ends_without_a_trace_if_its_turn_comes_too_late() -> None:
    board = deaf_board()
    outcomes: list[object] = []
    async with connected(board) as connection:
        await connection.request(PROJECT)
        assert connection.ask(UNKNOWN, lambda outcome, content: outcomes.append(outcome))
        await until_aside(connection)
        board.plan(QueryServoListRequest, late(2.9))
        await connection.request(LIST)
        await asyncio.sleep(0.1)
        assert isinstance(outcomes[0], RequestTimeout)
        assert connection.ask(LIST, lambda outcome, content: outcomes.append(outcome)), "nothing is in the way"
        await asyncio.sleep(1)
        assert isinstance(outcomes[1], QueryServoListResponse)


async def test_an_error_while_its_way_is_cleared_leaves_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    async with connected(deaf_board()) as connection:
        await connection.request(PROJECT)

        async def clear_way(*_: object) -> None:
            raise ConnectionLost("while its way was cleared")

        monkeypatch.setattr(RequestSender, "clear_way", clear_way)
        with pytest.raises(ConnectionLost, match="while its way was cleared"):
            await connection.request(UNKNOWN)
        monkeypatch.undo()
        assert (connection.callers, connection.has_waiting) == (1, False)
        await connection.request(PROJECT)


async def test_the_response_is_its_own_behind_a_lost_one_of_somebody_else() -> None:
    board = deaf_board()
    async with connected(board) as connection:
        await connection.request(PROJECT)
        asking = asyncio.create_task(connection.request(UNKNOWN))
        await until_aside(connection)
        with pytest.raises(RequestTimeout):
            await connection.request(UNKNOWN, timeout=0.05)
        board.forget_plans()
        before = len(board.sent_of(QueryActionRequest))
        await asking
        assert len(board.sent_of(QueryActionRequest)) == before + 1


async def test_it_comes_back_before_all_who_wait() -> None:
    board = deaf_board()
    async with connected(board) as connection:
        await connection.request(PROJECT)
        others = [asyncio.create_task(ask_for_ever(connection, LIST)) for _ in range(100)]
        with pytest.raises(RequestTimeout):
            await connection.request(UNKNOWN)
        for other in others:
            other.cancel()
        await asyncio.wait(others)
        tries = board.sent_of(QueryActionRequest)
        pauses = [after - before for before, after in pairwise(tries[3:])]
        assert len(pauses) >= 4
        assert all(after > before for before, after in pairwise(pauses))
        assert pauses[0] < 0.4


@pytest.mark.parametrize("seconds", [0.0, 0.1, 0.3])
async def test_the_end_of_the_connection_reaches_it(seconds: float) -> None:
    board = deaf_board()
    async with connected(board) as connection:
        board.plan(QueryServoListRequest, *[late(0.2)] * 9)
        other = asyncio.create_task(ask_for_ever(connection, LIST))
        asking = asyncio.create_task(connection.request(UNKNOWN))
        await until_aside(connection)
        await asyncio.sleep(seconds)
        begun = now()
        board.vanish()
        await asyncio.wait((asking, other))
        assert isinstance(asking.exception(), ConnectionLost)
        assert now() == begun


async def test_many_such_queries_end_as_one_does() -> None:
    board = deaf_board()
    async with connected(board) as connection:
        unknown = [asyncio.create_task(connection.request(QueryActionRequest(each))) for each in range(20)]
        other = asyncio.create_task(ask_for_ever(connection, LIST))
        await asyncio.wait(unknown)
        assert all(isinstance(each.exception(), RequestTimeout) for each in unknown)
        before = len(board.sent)
        await asyncio.sleep(1)
        assert len(board.sent) > before + 200
        assert connection.callers == 1
        other.cancel()
        await asyncio.wait((other,))


async def test_a_few_step_aside_at_once() -> None:
    board = deaf_board()
    most = 0
    async with connected(board, depth=16) as connection:
        callers = connection.callers
        unknown = [asyncio.create_task(connection.request(QueryActionRequest(each))) for each in range(40)]
        while not all(each.done() for each in unknown):
            most = max(most, connection.callers - callers)
            await asyncio.sleep(0.01)
        assert 1 < most <= MOST_ASIDE
        assert connection.callers == callers


async def test_each_caller_gets_the_response_to_its_own_query() -> None:
    """Two callers ask what the board does not know, and others what it knows: each gets what it asked for."""
    board = deaf_board()
    async with connected(board) as connection:
        unknown = [asyncio.create_task(connection.request(UNKNOWN)) for _ in range(2)]
        answers: list[Packet] = []
        while not all(each.done() for each in unknown):
            answers += [await connection.request(QueryProjectIDRequest()), await connection.request(LIST)]
        assert all(isinstance(each.exception(), RequestTimeout) for each in unknown)
        assert len({type(answer) for answer in answers[::2]}) == len({type(answer) for answer in answers[1::2]}) == 1
        assert connection.stats.unsolicited == 0
