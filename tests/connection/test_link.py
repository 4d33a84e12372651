"""Link: what is sent, when, how often, and what the caller is told."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink.errors import EncodeError
from servolink.protocol.editing import (
    AddActionRequest,
    QueryActionListRequest,
    QueryActionRequest,
    QueryActionResponse,
    QueryMacroRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    WriteProjectIDRequest,
)
from servolink.protocol.packet import Request
from servolink.protocol.records import Step
from servolink.protocol.servos import ExecuteActionRequest, QueryServoListRequest, QueryServoRequest
from servolink.protocol.settings import QueryMemorySizeRequest, QueryRemainPowerRequest, QueryRemainPowerResponse
from tests.client.fake_board import LATENCY, FakeBoard, Fate, lie, linked
from tests.virtual_time import run

PROJECT = QueryProjectIDRequest()


# --- answers ------------------------------------------------------------------------------------------------------


def test_a_request_returns_its_answer() -> None:
    async def main() -> None:
        board = FakeBoard(servos=3)
        async with linked(board) as link:
            assert (await link.request(QueryServoListRequest())).servo_id_list == (1, 2, 3)
            assert link.stats.frames_sent == link.stats.frames_received == 1
            assert list(link.stats.round_trips) == [pytest.approx(LATENCY)]

    run(main())


def test_two_gathered_requests_get_each_its_own_answer() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            await link.request(WriteProjectIDRequest(77))
            project, servo_ids = await asyncio.gather(link.request(PROJECT), link.request(QueryServoListRequest()))
            assert project == QueryProjectIDResponse(77)
            assert len(servo_ids.servo_id_list) == 4

    run(main())


@pytest.mark.parametrize("window", [1, 2, 8])
def test_a_thousand_gathered_requests_get_each_its_own_answer(window: int) -> None:
    async def main() -> None:
        board = FakeBoard(servos=250)
        async with linked(board, window=window) as link:
            requests = [QueryServoRequest(1 + number % 250) for number in range(500)]
            actions = [AddActionRequest(1 + number, f"action {number}") for number in range(50)]
            await asyncio.gather(*map(link.request, actions))
            asked = [QueryActionRequest(1 + number % 50) for number in range(500)]
            states, stored = await asyncio.gather(
                asyncio.gather(*map(link.request, requests)), asyncio.gather(*map(link.request, asked))
            )
        for request, answer in zip(requests, states, strict=True):
            assert [state.servo_id for state in answer.servos] == [request.servo_id]
        assert [answer.action_id for answer in stored] == [query.action_id for query in asked]
        assert link.stats.timeouts == link.stats.fences == link.stats.mismatched == 0

    run(main())


@pytest.mark.parametrize(("window", "most"), [(1, 1), (3, 3)])
def test_no_more_than_the_window_is_on_the_line(window: int, most: int) -> None:
    async def main() -> None:
        board = FakeBoard(usual=Fate(after=0.01))
        async with linked(board, window=window) as link:
            await asyncio.gather(
                *(
                    link.request(packet)
                    for packet in (PROJECT, QueryMemorySizeRequest(), QueryServoListRequest(), QueryActionListRequest())
                )
            )
        first = board.answered_at[0]
        assert len([at for at, _ in board.sent if at < first]) == most

    run(main())


def test_the_answer_is_awaited_before_the_first_byte_is_written() -> None:
    """A board in the same process may answer from within `send`."""

    class Eager(FakeBoard):
        async def send(self, data: bytes) -> None:
            self.speak(QueryProjectIDResponse(5))

    async def main() -> None:
        async with linked(Eager()) as link:
            assert (await link.request(PROJECT)).project_id == 5

    run(main())


def test_an_answer_is_delivered_to_the_right_one_of_several_on_the_line() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board, window=4) as link:
            board.plan(QueryProjectIDRequest, lie(QueryProjectIDResponse(1)))
            board.plan(QueryRemainPowerRequest, lie(QueryRemainPowerResponse(2)))
            project, power = await asyncio.gather(link.request(PROJECT), link.request(QueryRemainPowerRequest()))
            assert (project.project_id, power.permil) == (1, 2)

    run(main())


def test_an_answer_about_something_else_is_counted_and_never_delivered() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            board.plan(QueryActionRequest, lie(QueryActionResponse(8, "another one")))
            answer = await link.request(QueryActionRequest(7))
            assert answer.action_id == 0  # the truth, from the second try
            assert link.stats.mismatched == 1
            assert board.executed_of(QueryActionRequest) == [QueryActionRequest(7)] * 2

    run(main())


def test_zero_in_place_of_the_key_is_the_answer_no() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            assert (await link.request(QueryMacroRequest(9))).macro_id == 0
            assert len(board.sent) == 1
            assert link.stats.mismatched == 0

    run(main())


def test_answers_that_nobody_asked_for_are_counted_and_change_nothing() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            board.speak(QueryProjectIDResponse(5), QueryServoListRequest(), QueryActionResponse(1, "x"))
            await link.request(PROJECT)
            assert link.stats.unsolicited == 3
            assert link.stats.late_responses == 0

    run(main())


# --- values are checked first -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("packet", "words"),
    [
        (QueryServoRequest(256), r"QueryServoRequest\.servo_id.*256.*0\.\.255"),
        (WriteProjectIDRequest(2**31), r"WriteProjectIDRequest\.project_id.*2147483648"),
        (AddActionRequest(1, "x" * 33), r"AddActionRequest\.action_caption"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_is_sent(packet: Request[Any], words: str) -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            with pytest.raises(EncodeError, match=words):
                await link.request(packet)
            with pytest.raises(EncodeError, match="interval"):
                await link.send(ExecuteActionRequest((Step(1, 0, -1),)))
            assert board.sent == []
            await link.request(PROJECT)

    run(main())
