"""Requests that are given up: a board that is silent about one, `timeout`, and what the caller is told."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import pytest

from servolink.connection.slots import FENCES_ONLY
from servolink.errors import DecodeError, OutcomeUnknown, RequestTimeout
from servolink.motion import Ticket
from servolink.protocol import (
    AddActionRequest,
    ButtonEventResponse,
    ClearAllDataRequest,
    Packet,
    QueryActionRequest,
    QueryServoListRequest,
    QueryServoRequest,
)
from servolink.testing import Fate
from tests.client.piped_board import LATENCY, LOST, SWALLOWED, PipedBoard, connected, late, now
from tests.connection.unanswered import FENCE_KINDS, LIST, PROJECT, ask_for_ever, cut_content, kinds

# --- a board that is silent about one request ---------------------------------------------------------------------


async def test_what_a_board_leaves_unanswered_while_it_answers_others_ends_with_a_timeout_that_says_so() -> None:
    board = PipedBoard()
    board.usual_of[QueryActionRequest] = LOST
    async with connected(board, depth=2) as connection:
        others = asyncio.create_task(ask_for_ever(connection, LIST))
        begun = now()
        with pytest.raises(
            RequestTimeout, match="the board answers other requests, so it may not know this one"
        ) as caught:
            await connection.request(QueryActionRequest(7))
        assert now() == pytest.approx(begun + 3, abs=0.3)
        assert "the board has answered before" not in str(caught.value)
        others.cancel()
        await asyncio.wait((others,))
        assert connection.ended is None


async def test_it_is_sent_again_three_times_without_a_pause_and_then_ever_more_slowly() -> None:
    board = PipedBoard()
    board.usual_of[QueryActionRequest] = LOST
    async with connected(board, depth=2) as connection:
        others = asyncio.create_task(ask_for_ever(connection, LIST))
        with pytest.raises(RequestTimeout):
            await connection.request(QueryActionRequest(7))
        others.cancel()
        await asyncio.wait((others,))
        sent = board.sent_of(QueryActionRequest)
        pauses = [after - before for before, after in pairwise(sent)]
        assert max(pauses[:3]) < 3 * LATENCY
        assert pauses[3] >= 0.14
        assert all(after > before for before, after in pairwise(pauses[3:7]))
        assert len(sent) <= 12


async def test_an_overdue_request_leaves_its_place_to_others() -> None:
    board = PipedBoard()
    board.usual_of[AddActionRequest] = late(2.0)
    async with connected(board) as connection:
        with pytest.raises(OutcomeUnknown):
            await connection.request(AddActionRequest(1), timeout=0.1)
        begun = now()
        await connection.request(LIST)  # behind the late one, as the board answers in order
        assert now() == pytest.approx(begun + 1.9)


async def test_while_very_much_is_overdue_only_fences_are_sent() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board) as connection:
        loop = asyncio.get_running_loop()
        for number in range(FENCES_ONLY):
            loop.call_later(0.005, board.speak, ButtonEventResponse(1, 1))
            with pytest.raises(RequestTimeout):
                await connection.request(QueryActionRequest(number), timeout=0.01)
        assert connection.slots.overdue == len(board.sent) == FENCES_ONLY
        board.usual = Fate()
        await connection.request(QueryActionRequest(FENCES_ONLY))
        assert [type(packet) in FENCE_KINDS for _, packet in board.sent[FENCES_ONLY:]] == [True, False]
        assert connection.slots.overdue == 0


async def test_then_no_repeat_is_sent_either() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board) as connection:
        loop = asyncio.get_running_loop()
        for number in range(FENCES_ONLY - 1):
            loop.call_later(0.005, board.speak, ButtonEventResponse(1, 1))
            with pytest.raises(RequestTimeout):
                await connection.request(QueryActionRequest(number), timeout=0.01)
        board.sent.clear()
        with pytest.raises(RequestTimeout):
            await connection.request(QueryActionRequest(FENCES_ONLY))
        assert [kind in FENCE_KINDS for kind in kinds(board)] == [False] + [True] * (len(board.sent) - 1)
        assert len(board.sent) > 3


# --- `timeout` ----------------------------------------------------------------------------------------------------


async def test_a_timeout_limits_the_whole_call_also_a_longer_one() -> None:
    board = PipedBoard()
    board.plan(AddActionRequest, late(4.0), SWALLOWED)
    async with connected(board) as connection:
        assert (await connection.request(AddActionRequest(1), timeout=5)).result
        begun = now()
        for kind in FENCE_KINDS:
            board.usual_of[kind] = LOST
        with pytest.raises(OutcomeUnknown, match=r"in 2\.0 s"):
            await connection.request(AddActionRequest(2), timeout=2)
        assert now() == pytest.approx(begun + 2)


@pytest.mark.parametrize("timeout", [0.05, 1.0, 2.5])
async def test_a_timeout_counts_while_the_request_waits_for_others(timeout: float) -> None:
    board = PipedBoard()
    board.plan(ClearAllDataRequest, late(20))
    async with connected(board) as connection:
        clearing = asyncio.create_task(connection.request(ClearAllDataRequest()))
        await asyncio.sleep(0.1)
        begun = now()
        with pytest.raises(RequestTimeout, match=rf"and not sent in {timeout:.1f} s"):
            await connection.request(LIST, timeout=timeout)
        assert now() == pytest.approx(begun + timeout)
        assert board.sent_of(QueryServoListRequest) == []
        assert (await clearing).result == 1


async def test_a_timeout_counts_on_when_the_request_has_its_turn() -> None:
    board = PipedBoard()
    board.plan(ClearAllDataRequest, late(2))
    board.usual_of[QueryServoListRequest] = LOST
    async with connected(board) as connection:
        clearing = asyncio.create_task(connection.request(ClearAllDataRequest()))
        await asyncio.sleep(0)
        begun = now()
        with pytest.raises(RequestTimeout):
            await connection.request(LIST, timeout=2.5)
        assert now() == pytest.approx(begun + 2.5)
        await clearing


async def test_a_timeout_counts_while_a_board_is_checked_and_then_while_the_request_waits_for_others() -> None:
    async def check(packet: Packet, ticket: Ticket) -> None:
        await asyncio.sleep(0.9)

    board = PipedBoard()
    board.plan(QueryServoListRequest, late(2))
    async with connected(board) as connection:
        connection.preparations = (check,)
        listing = asyncio.create_task(connection.request(LIST))
        await asyncio.sleep(0)
        begun = now()
        with pytest.raises(RequestTimeout, match=r"and not sent in 1\.0 s"):
            await connection.request(AddActionRequest(1), timeout=1.0)
        assert now() == pytest.approx(begun + 1.0)
        await listing


async def test_a_timeout_ends_a_pause_between_two_tries() -> None:
    board = PipedBoard()
    board.usual_of[QueryServoListRequest] = Fate(damage=cut_content)
    async with connected(board) as connection:
        begun = now()
        with pytest.raises(DecodeError):
            await connection.request(LIST, timeout=0.3)
        assert now() == pytest.approx(begun + 0.3)


async def test_a_timeout_counts_while_fences_are_sent() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board) as connection:
        with pytest.raises(OutcomeUnknown):
            await connection.request(AddActionRequest(1), timeout=0.1)
        begun = now()
        with pytest.raises(RequestTimeout, match="not sent"):
            await connection.request(AddActionRequest(1), timeout=0.7)
        assert now() == pytest.approx(begun + 0.7)


# --- what the caller is told --------------------------------------------------------------------------------------


async def test_a_timeout_says_what_was_asked_of_whom_for_how_long_and_why_likely() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board, patience=0.5) as connection:
        with pytest.raises(RequestTimeout) as caught:
            await connection.request(QueryServoRequest(3))
        assert caught.value.request == QueryServoRequest(3)
        assert isinstance(caught.value, TimeoutError)
        text = str(caught.value)
        assert text.startswith("QueryServoRequest(servo_id=3) was not answered by fake://board in 0.5 s (2 tries)")
        causes = [
            "nothing came at all",
            "is the board on",
            "is this its port",
            "data cable",
            "baud rate",
            "byte order",
            "servolink doctor",
        ]
        positions = [text.index(cause) for cause in causes]
        assert positions == sorted(positions)


async def test_a_timeout_blames_the_settings_when_bytes_come_but_no_frame() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board, patience=0.5) as connection:
        board.deliver(b"login: ")
        with pytest.raises(RequestTimeout, match=r"byte order or baud rate .*; 7 received bytes were part of no frame"):
            await connection.request(PROJECT)


async def test_a_timeout_blames_the_line_when_the_board_has_answered_before() -> None:
    board = PipedBoard()
    board.plan(QueryServoListRequest, *[LOST] * 3)
    async with connected(board, patience=0.5) as connection:
        await connection.request(PROJECT)
        with pytest.raises(RequestTimeout, match=r"\(3 tries\): the board has answered before"):
            await connection.request(LIST)


async def test_a_timeout_says_that_the_hub_has_tried() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board, through_hub=True) as connection:
        with pytest.raises(RequestTimeout, match=r"\(1 try\): the hub has sent it several times and got no"):
            await connection.request(LIST)


# --- damaged responses --------------------------------------------------------------------------------------------


async def test_a_late_response_after_damaged_ones_ends_the_call_at_once() -> None:
    board = PipedBoard()
    damaged = Fate(damage=cut_content)
    board.plan(QueryServoListRequest, *[damaged] * 3, Fate(delay=0.06, damage=cut_content), late(0.4))
    async with connected(board) as connection:
        assert (await connection.request(LIST)).servo_id_list == (1, 2, 3, 4)
        assert len(board.sent_of(QueryServoListRequest)) == 6
        assert now() == pytest.approx(board.sent_of(QueryServoListRequest)[4] + 0.4)


async def test_a_damaged_response_to_a_query_is_asked_for_again_at_once() -> None:
    board = PipedBoard()
    board.plan(QueryServoListRequest, *[Fate(damage=cut_content)] * 3)
    async with connected(board) as connection:
        begun = now()
        assert (await connection.request(LIST)).servo_id_list == (1, 2, 3, 4)
        assert now() - begun < 0.1
        assert connection.stats.undecodable == 3
        assert connection.stats.timeouts == 0


async def test_a_query_whose_responses_are_all_damaged_says_how_when_the_patience_ends() -> None:
    board = PipedBoard()
    board.usual_of[QueryServoListRequest] = Fate(damage=cut_content)
    async with connected(board) as connection:
        begun = now()
        with pytest.raises(DecodeError, match="QueryServoListResponse") as caught:
            await connection.request(LIST)
        assert now() == pytest.approx(begun + 3, abs=0.01)
        assert len(board.sent) <= 16
        assert caught.value.data == bytes((5, 1, 2, 3, 4))
        board.forget_plans()
        await connection.request(LIST)
