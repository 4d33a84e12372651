"""Opener: the first opening with those who wait for it, and further ones for a response that nobody asked for."""

from __future__ import annotations

import asyncio

import pytest

from servolink.errors import ConnectionLost, OutcomeUnknown, RequestTimeout
from servolink.protocol import (
    AddActionRequest,
    Packet,
    QueryActionListRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    WriteProjectIDRequest,
)
from servolink.testing import Fate
from tests.client.piped_board import LATENCY, LOST, SWALLOWED, PipedBoard, late, now
from tests.connection.openings import FENCE_KINDS, LIST, STOP, kinds, opening

STRANGER = QueryProjectIDResponse(666)

# --- who waits for the first one ----------------------------------------------------------------------------------


async def test_the_first_request_brings_it_about() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        assert len((await connection.request(LIST)).servo_id_list) == 4
        assert set(kinds(board)[:6]) <= set(FENCE_KINDS)
        assert kinds(board)[6:] == [QueryServoListRequest]


async def test_all_who_ask_meanwhile_wait_for_the_same_one() -> None:
    board = PipedBoard()
    async with opening(board, depth=4) as connection:
        await asyncio.gather(
            connection.shake_hands(),
            connection.request(LIST),
            connection.request(QueryProjectIDRequest()),
            connection.shake_hands(),
        )
        assert len(board.sent) == 8


async def test_who_is_cancelled_leaves_it_to_the_others() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        first = asyncio.create_task(connection.shake_hands())
        second = asyncio.create_task(connection.request(LIST))
        await asyncio.sleep(2.5 * LATENCY)
        first.cancel()
        assert len((await second).servo_id_list) == 4
        assert first.cancelled()
        assert len(board.sent) == 7


async def test_one_that_nobody_waits_for_any_more_serves_the_next() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        asking = asyncio.create_task(connection.request(LIST))
        await asyncio.sleep(2.5 * LATENCY)
        asking.cancel()
        await asyncio.sleep(1)
        assert len(board.sent) == 6
        await connection.request(LIST)
        assert len(board.sent) == 7


async def test_a_time_limit_counts_meanwhile() -> None:
    board = PipedBoard(usual=late(0.2))
    async with opening(board) as connection:
        begun = now()
        with pytest.raises(RequestTimeout, match=r"not sent in 0\.5 s"):
            await connection.request(LIST, timeout=0.5)
        assert now() == pytest.approx(begun + 0.5)


# --- a response that nobody asked for -----------------------------------------------------------------------------


async def test_a_response_that_nobody_asked_for_opens_the_connection_again() -> None:
    """Then it was opened on the responses to another program, and whatever is under way is in doubt."""
    board = PipedBoard()
    async with opening(board, depth=2) as connection:
        await connection.shake_hands()
        board.sent.clear()
        board.plan(QueryActionListRequest, late(0.2))
        board.plan(AddActionRequest, late(0.2))
        query = asyncio.create_task(connection.request(QueryActionListRequest()))
        command = asyncio.create_task(connection.request(AddActionRequest(1)))
        await asyncio.sleep(0.1)
        board.speak(STRANGER)
        assert len((await query).actions) == 1
        with pytest.raises(OutcomeUnknown):
            await command
        assert connection.stats.reopenings == 1
        assert board.executed_of(AddActionRequest) == [AddActionRequest(1)]
        assert len(board.sent_of(QueryActionListRequest)) == 2
        assert sum(kind in FENCE_KINDS for kind in kinds(board)) >= 6


async def test_it_does_so_at_most_once_in_ten_seconds() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        await connection.shake_hands()
        reopenings = []
        for number in range(25):
            board.speak(QueryProjectIDResponse(600 + number))
            await asyncio.sleep(1)
            reopenings.append(connection.stats.reopenings)
        assert reopenings == [1] * 10 + [2] * 10 + [3] * 5
        assert connection.stats.unsolicited == 25
        assert (await connection.request(WriteProjectIDRequest(4))).result == 1


@pytest.mark.parametrize("packet", [QueryServoListResponse((1,)), QueryServoListRequest()])
async def test_what_no_handshake_could_have_been_deceived_by_opens_nothing(packet: Packet) -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        await connection.shake_hands()
        board.speak(packet)
        await asyncio.sleep(1)
        assert connection.stats.reopenings == 0
        assert connection.stats.unsolicited == 1


async def test_after_the_end_it_opens_nothing() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        await connection.shake_hands()
        sent = len(board.sent)
        board.vanish()
        board.speak(STRANGER)
        await asyncio.sleep(1)
        assert connection.stats.reopenings == 0
        assert len(board.sent) == sent


async def test_a_stop_waits_for_no_second_opening_either() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        await connection.shake_hands()
        board.usual = SWALLOWED
        board.speak(STRANGER)
        await asyncio.sleep(0.1)
        begun = now()
        await connection.send_stop(STOP)
        assert board.sent[-1] == (begun, STOP)
        board.usual = Fate()
        await connection.request(LIST)


async def test_a_second_opening_that_fails_ends_the_connection() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        await connection.shake_hands()
        board.usual = LOST
        asking = asyncio.create_task(connection.request(LIST))
        await asyncio.sleep(0.1)
        board.speak(STRANGER)
        with pytest.raises(ConnectionLost, match="no board answers"):
            await asking
        assert connection.ended is not None
