"""A deadline that passes while a frame comes in pieces must not cut that frame off, whoever it is for."""

from __future__ import annotations

import asyncio

import pytest

from servolink.errors import OutcomeUnknown, RequestTimeout
from servolink.protocol import (
    HEADER,
    MAGIC,
    AddActionRequest,
    AddActionResponse,
    AddMacroRequest,
    ButtonEventResponse,
    QueryServoListRequest,
    QueryServoListResponse,
)
from tests.client.piped_board import LATENCY, SWALLOWED, PipedBoard, connected, now


def in_pieces(board: PipedBoard, data: bytes, *when: float) -> None:
    """Bring `data` at these moments from now, a few bytes each time and the rest at the last."""
    loop = asyncio.get_running_loop()
    for at, seconds in enumerate(when):
        piece = data[at * 4 : None if at == len(when) - 1 else at * 4 + 4]
        loop.call_later(seconds, board.deliver, piece)


@pytest.mark.parametrize("ends", [1.01, 1.4])
async def test_an_answer_is_not_cut_off_by_the_deadlines_of_other_requests(ends: float) -> None:
    board = PipedBoard(usual=SWALLOWED)
    async with connected(board, depth=3) as link:
        others = [
            asyncio.create_task(link.request(AddMacroRequest(1), timeout=1.0)),
            asyncio.create_task(link.request(QueryServoListRequest(), timeout=1.001)),
        ]
        await asyncio.sleep(0.5)
        awaited = asyncio.create_task(link.request(AddActionRequest(1)))
        in_pieces(board, board.codec.encode(AddActionResponse(1)), 0.1, 0.2, ends - 0.5)
        gone = await asyncio.gather(*others, return_exceptions=True)
        assert [type(each) for each in gone] == [OutcomeUnknown, RequestTimeout]
        assert await awaited == AddActionResponse(1)
        assert now() == 1000 + ends


async def test_an_event_that_comes_just_when_a_deadline_passes_is_not_lost() -> None:
    board = PipedBoard()
    board.plan(AddActionRequest, SWALLOWED)
    async with connected(board) as link:
        events: list[ButtonEventResponse] = []
        link.answers.on_event = events.append
        in_pieces(board, board.codec.encode(ButtonEventResponse(7, 1)), 0.97, 0.99, 1.02)
        with pytest.raises(OutcomeUnknown):
            await link.request(AddActionRequest(1))
        assert now() == pytest.approx(1001.04 + LATENCY)
        assert events == [ButtonEventResponse(7, 1)]
        assert sum(link.stats.skipped.values()) == 0


async def test_an_answer_that_comes_just_when_a_try_ends_counts() -> None:
    board = PipedBoard(usual=SWALLOWED)
    async with connected(board) as link:
        in_pieces(board, board.codec.encode(QueryServoListResponse((5, 6))), 0.22, 0.24, 0.27)
        assert await link.request(QueryServoListRequest()) == QueryServoListResponse((5, 6))
        assert link.stats.retries == 0


async def test_an_answer_with_pauses_longer_than_its_timeout_is_waited_for() -> None:
    board = PipedBoard(usual=SWALLOWED)
    async with connected(board, patience=0.005) as link:
        in_pieces(board, board.codec.encode(QueryServoListResponse((5, 6))), 0.001, 0.004, 0.03, 0.06)
        assert await link.request(QueryServoListRequest()) == QueryServoListResponse((5, 6))


async def test_what_trickles_in_holds_no_deadline_up_for_long() -> None:
    board = PipedBoard(usual=SWALLOWED)
    async with connected(board) as link:
        endless = HEADER["little"].pack(MAGIC, 10050, 0xFFFF) + bytes(10_000)
        in_pieces(board, endless, *(at / 100 for at in range(1, 1000)))
        with pytest.raises(RequestTimeout):
            await link.request(QueryServoListRequest())
        assert 1003 < now() < 1005


async def test_what_has_been_silent_for_a_moment_is_given_up_at_the_deadline() -> None:
    board = PipedBoard()
    board.plan(AddActionRequest, SWALLOWED)
    async with connected(board) as link:
        in_pieces(board, HEADER["little"].pack(MAGIC, 10050, 100), 0.1, 0.5, 0.949)
        with pytest.raises(OutcomeUnknown):
            await link.request(AddActionRequest(1))
        assert now() == pytest.approx(1001 + LATENCY)
        assert link.stats.skipped["incomplete"] == 8
