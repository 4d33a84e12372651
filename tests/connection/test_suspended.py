"""While another program has a shared board alone, requests wait, and nothing counts as late."""

from __future__ import annotations

import asyncio

import pytest

from servolink.errors import RequestTimeout
from servolink.protocol import (
    ALL_SERVOS,
    QueryActionListRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    SetServoParameterRequest,
    WriteProjectIDRequest,
)
from servolink.testing import Fate
from tests.client.piped_board import SWALLOWED, PipedBoard, connected, late

REASON = "studio has exclusive use of the board (a project is being written)"


async def test_requests_wait_however_long_it_takes() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        connection.suspend(REASON)
        asked = asyncio.create_task(connection.request(QueryProjectIDRequest()))
        await asyncio.sleep(1000)
        assert not board.sent
        connection.resume()
        assert (await asked).project_id == 0
        assert connection.stats.timeouts == connection.stats.retries == 0


async def test_who_waits_for_some_time_only_is_told_why() -> None:
    async with connected(PipedBoard()) as connection:
        connection.suspend(REASON + "\u202e")
        with pytest.raises(RequestTimeout) as timed_out:
            await connection.request(QueryProjectIDRequest(), timeout=2)
        assert f"{REASON}\\u202e; try again later" in str(timed_out.value)


@pytest.mark.parametrize("request_", [QueryActionListRequest(), WriteProjectIDRequest(7)])
async def test_what_is_under_way_is_not_given_up(request_: QueryActionListRequest | WriteProjectIDRequest) -> None:
    board = PipedBoard()
    board.plan(type(request_), late(100))
    async with connected(board) as connection:
        asked = asyncio.create_task(connection.request(request_))
        await asyncio.sleep(0.01)
        connection.suspend(REASON)
        await asyncio.sleep(99.9)
        connection.resume()
        await asked
        assert len(board.sent) == 1
        assert connection.stats.timeouts == 0


async def test_afterwards_a_silent_board_is_not_lost_for_its_earlier_silence() -> None:
    board = PipedBoard()
    board.plan(QueryProjectIDRequest, SWALLOWED)
    async with connected(board) as connection:
        asked = asyncio.create_task(connection.request(QueryProjectIDRequest()))
        await asyncio.sleep(0.01)
        connection.suspend(REASON)
        await asyncio.sleep(1000)
        connection.resume()
        await asked
        assert connection.ended is None


async def test_a_stop_does_not_wait() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        connection.suspend(REASON)
        await connection.send_stop(SetServoParameterRequest(ALL_SERVOS, 0, 1))
        assert len(board.sent) == 1
        connection.resume()


async def test_to_go_on_without_having_waited_changes_nothing() -> None:
    async with connected(PipedBoard(), handshake=True) as connection:
        connection.resume()
        assert await connection.request(QueryProjectIDRequest()) == QueryProjectIDResponse(0)


async def test_a_hub_may_be_silent_for_as_long_as_its_board_is_gone() -> None:
    board = PipedBoard(usual=SWALLOWED)
    async with connected(board, through_hub=True) as connection:
        for _ in range(100):
            with pytest.raises(RequestTimeout):
                await connection.request(QueryProjectIDRequest())
        assert connection.ended is None
        board.usual = Fate()
        for _ in range(3):
            await connection.request(QueryProjectIDRequest())
            await connection.request(QueryActionListRequest())
