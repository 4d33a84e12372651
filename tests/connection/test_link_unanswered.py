"""Link: what the caller is told when no answer comes, or a damaged one."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink.errors import DecodeError, OutcomeUnknown, RequestTimeout
from servolink.protocol.editing import (
    AddActionRequest,
    DeleteActionRequest,
    ExecuteMacroRequest,
    QueryProjectIDRequest,
    WriteProjectIDRequest,
)
from servolink.protocol.packet import Request
from servolink.protocol.records import Step
from servolink.protocol.servos import (
    ALL_SERVOS,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoRequest,
    SetServoParameterRequest,
)
from servolink.protocol.settings import ClearAllDataRequest
from tests.client.fake_board import LOST, SWALLOWED, FakeBoard, Fate, late, linked, now
from tests.virtual_time import run

PROJECT = QueryProjectIDRequest()


def cut_content(frame: bytes) -> bytes:
    """Return a frame with right length and sum whose count field says one more than there is."""
    content = bytearray(frame[8:-1])
    content[0] += 1
    body = frame[:8] + bytes(content)
    return body + bytes((sum(body) & 0xFF,))


# --- no answer ----------------------------------------------------------------------------------------------------


def test_a_query_is_repeated_twice_within_one_total_deadline() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, *[LOST] * 9)
        async with linked(board, timeout=1.0) as link:
            begun = now()
            with pytest.raises(RequestTimeout):
                await link.request(QueryServoListRequest())
            assert len(board.sent_of(QueryServoListRequest)) == 3
            assert now() - begun <= 3.0
            assert link.stats.retries == 2
            assert link.stats.timeouts == 3

    run(main())


@pytest.mark.parametrize("fence_answers", [0.01, 0.4, 0.9])
def test_retries_behind_slow_fences_stay_within_the_total_deadline(fence_answers: float) -> None:
    async def main() -> None:
        board = FakeBoard(usual=late(fence_answers))
        board.plan(QueryServoListRequest, *[LOST] * 9)
        async with linked(board, timeout=1.0) as link:
            begun = now()
            with pytest.raises(RequestTimeout):
                await link.request(QueryServoListRequest())
            assert now() - begun <= 3.0 + 1e-6

    run(main())


def test_nothing_is_sent_for_which_too_little_time_is_left() -> None:
    async def main() -> None:
        board = FakeBoard(usual=late(0.9975))
        board.plan(QueryServoListRequest, *[LOST] * 9)
        async with linked(board, timeout=1.0) as link:
            begun = now()
            with pytest.raises(RequestTimeout, match=r"\(2 tries\)"):
                await link.request(QueryServoListRequest())
            assert now() - begun == pytest.approx(2.9975)
            assert len(board.sent) == 3  # the query, a fence, the query

    run(main())


@pytest.mark.parametrize(("retries", "times"), [(0, 1), (1, 2), (4, 5)])
def test_how_often_can_be_said_for_one_request(retries: int, times: int) -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, *[LOST] * 9)
        async with linked(board) as link:
            with pytest.raises(RequestTimeout):
                await link.request(QueryServoListRequest(), retries=retries)
            assert len(board.sent) - link.stats.fences == times

    run(main())


def test_how_long_can_be_said_for_one_request() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(WriteProjectIDRequest, late(4.0), SWALLOWED)
        async with linked(board, timeout=1.0) as link:
            assert (await link.request(WriteProjectIDRequest(1), timeout=5)).result
            begun = now()
            with pytest.raises(OutcomeUnknown):
                await link.request(WriteProjectIDRequest(2), timeout=2)
            assert now() == pytest.approx(begun + 2)

    run(main())


def test_the_retry_of_a_lost_query_is_answered() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryProjectIDRequest, LOST)
        async with linked(board) as link:
            begun = now()
            await link.request(PROJECT)
            assert now() - begun < 1.1
            assert link.stats.retries == 1

    run(main())


@pytest.mark.parametrize(
    "packet",
    [
        WriteProjectIDRequest(3),
        AddActionRequest(1, "a"),
        DeleteActionRequest(1),
        ExecuteMacroRequest(1),
        SetServoParameterRequest(ALL_SERVOS, 1, 1),
        ClearAllDataRequest(),
    ],
)
@pytest.mark.parametrize("fate", [LOST, SWALLOWED, late(1.5)])
def test_what_changes_the_board_is_sent_once_and_its_outcome_is_unknown(packet: Request[Any], fate: Fate) -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(type(packet), fate)
        async with linked(board) as link:
            begun = now()
            with pytest.raises(OutcomeUnknown) as caught:
                await link.request(packet)
            assert now() == begun + 1.0
            assert caught.value.request == packet
            await asyncio.sleep(5)
            await link.request(PROJECT)
            assert len(board.executed_of(type(packet))) <= 1
            assert len(board.sent_of(type(packet))) == 1

    run(main())


def test_movements_are_sent_once_and_return_when_sent() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            begun = now()
            await link.send(ExecuteActionRequest((Step(1, 10, 100),)))
            await link.send(ExecuteActionExRequest(4))
            assert now() == begun
            await asyncio.sleep(10)
            assert [type(packet) for _, packet in board.executed] == [ExecuteActionRequest, ExecuteActionExRequest]

    run(main())


def test_a_timeout_says_what_was_asked_of_whom_for_how_long_and_why_likely() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with linked(board, timeout=0.5) as link:
            with pytest.raises(RequestTimeout) as caught:
                await link.request(QueryServoRequest(3))
            assert caught.value.request == QueryServoRequest(3)
            assert isinstance(caught.value, TimeoutError)
            text = str(caught.value)
            assert text.startswith("QueryServoRequest(servo_id=3) was not answered by fake://board in 1.5 s (1 try)")
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

    run(main())


def test_a_timeout_blames_the_settings_when_bytes_come_but_no_frame() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with linked(board) as link:
            board.deliver(b"login: ")
            with pytest.raises(
                RequestTimeout, match=r"byte order or baud rate .*; 7 received bytes were part of no frame"
            ):
                await link.request(PROJECT)

    run(main())


def test_a_timeout_blames_the_line_when_the_board_has_answered_before() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, *[LOST] * 3)
        async with linked(board) as link:
            await link.request(PROJECT)
            with pytest.raises(RequestTimeout, match=r"\(3 tries\): the board has answered before"):
                await link.request(QueryServoListRequest())

    run(main())


# --- damaged answers ----------------------------------------------------------------------------------------------


def test_a_damaged_answer_to_a_query_is_asked_for_again_at_once() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, Fate(mangle=cut_content))
        async with linked(board) as link:
            begun = now()
            assert (await link.request(QueryServoListRequest())).servo_id_list == (1, 2, 3, 4)
            assert now() - begun < 0.1
            assert link.stats.undecodable == 1
            assert link.stats.timeouts == 0

    run(main())


def test_a_query_whose_answers_are_all_damaged_says_how() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, *[Fate(mangle=cut_content)] * 3)
        async with linked(board) as link:
            with pytest.raises(DecodeError, match="QueryServoListResponse") as caught:
                await link.request(QueryServoListRequest())
            assert caught.value.data == bytes((5, 1, 2, 3, 4))
            await link.request(QueryServoListRequest())

    run(main())
