"""Requests on a good line: what is sent when, and whose the response is."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink.connection.gates import UnitsChanged
from servolink.errors import EncodeError, RequestTimeout
from servolink.motion import Ticket
from servolink.protocol import (
    AddActionRequest,
    ExecuteActionRequest,
    Packet,
    QueryActionListRequest,
    QueryActionRequest,
    QueryActionResponse,
    QueryMacroRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryRemainPowerRequest,
    QueryRemainPowerResponse,
    QueryServoListRequest,
    QueryServoRequest,
    Request,
    SetAngleUnitRequest,
    Step,
    WriteProjectIDRequest,
)
from servolink.testing import Fate
from tests.client.piped_board import LATENCY, PipedBoard, connected, lie

PROJECT = QueryProjectIDRequest()


# --- answers ------------------------------------------------------------------------------------------------------


async def test_a_request_returns_its_answer() -> None:
    board = PipedBoard(servos=3)
    async with connected(board) as connection:
        assert (await connection.request(QueryServoListRequest())).servo_id_list == (1, 2, 3)
        assert connection.stats.frames_sent == connection.stats.frames_received == 1
        assert list(connection.stats.round_trips) == [pytest.approx(LATENCY)]


async def test_two_gathered_requests_get_each_its_own_answer() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        await connection.request(WriteProjectIDRequest(77))
        project, servo_ids = await asyncio.gather(
            connection.request(PROJECT), connection.request(QueryServoListRequest())
        )
        assert project == QueryProjectIDResponse(77)
        assert len(servo_ids.servo_id_list) == 4


@pytest.mark.parametrize("depth", [1, 2, 8])
async def test_a_thousand_gathered_requests_get_each_its_own_answer(depth: int) -> None:
    board = PipedBoard(servos=250)
    async with connected(board, depth=depth) as connection:
        requests = [QueryServoRequest(1 + number % 250) for number in range(500)]
        actions = [AddActionRequest(1 + number, f"action {number}") for number in range(50)]
        await asyncio.gather(*map(connection.request, actions))
        asked = [QueryActionRequest(1 + number % 50) for number in range(500)]
        states, stored = await asyncio.gather(
            asyncio.gather(*map(connection.request, requests)), asyncio.gather(*map(connection.request, asked))
        )
    for request, answer in zip(requests, states, strict=True):
        assert [state.servo_id for state in answer.servos] == [request.servo_id]
    assert [answer.action_id for answer in stored] == [query.action_id for query in asked]
    assert connection.stats.timeouts == connection.stats.retries == connection.stats.mismatched == 0


@pytest.mark.parametrize(("depth", "most"), [(1, 1), (3, 3)])
async def test_no_more_than_the_window_is_on_the_line(depth: int, most: int) -> None:
    board = PipedBoard(usual=Fate(delay=0.01))
    async with connected(board, depth=depth) as connection:
        await asyncio.gather(
            *(
                connection.request(packet)
                for packet in (PROJECT, QueryMemorySizeRequest(), QueryServoListRequest(), QueryActionListRequest())
            )
        )
    first = board.answered_at[0]
    assert len([at for at, _ in board.sent if at < first]) == depth


async def test_the_answer_is_awaited_before_the_first_byte_is_written() -> None:
    """A board in the same process may answer from within `take`."""

    class Eager(PipedBoard):
        def take(self, data: bytes) -> None:
            self.speak(QueryProjectIDResponse(5))

    async with connected(Eager()) as connection:
        assert (await connection.request(PROJECT)).project_id == 5


async def test_an_answer_is_delivered_to_the_right_one_of_several_on_the_line() -> None:
    board = PipedBoard()
    async with connected(board, depth=4) as connection:
        board.plan(QueryProjectIDRequest, lie(QueryProjectIDResponse(1)))
        board.plan(QueryRemainPowerRequest, lie(QueryRemainPowerResponse(2)))
        project, power = await asyncio.gather(
            connection.request(PROJECT), connection.request(QueryRemainPowerRequest())
        )
        assert (project.project_id, power.permil) == (1, 2)


async def test_an_answer_about_something_else_is_counted_and_never_delivered() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        board.plan(QueryActionRequest, lie(QueryActionResponse(8, "another one")))
        answer = await connection.request(QueryActionRequest(7))
        assert answer.action_id == 0  # the truth, from the second try
        assert connection.stats.mismatched == 1
        assert board.executed_of(QueryActionRequest) == [QueryActionRequest(7)] * 2


async def test_zero_in_place_of_the_key_is_the_answer_no() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        assert (await connection.request(QueryMacroRequest(9))).macro_id == 0
        assert len(board.sent) == 1
        assert connection.stats.mismatched == 0


async def test_answers_that_nobody_asked_for_are_counted_and_change_nothing() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        board.speak(QueryProjectIDResponse(5), QueryServoListRequest(), QueryActionResponse(1, "x"))
        await connection.request(PROJECT)
        assert connection.stats.unsolicited == 3
        assert connection.stats.late_responses == 0


async def test_a_packet_can_be_made_to_depend_on_the_angle_units_sent_since_another_moment() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        checked = connection.stops.ticket().checked(connection.units_sent)
        move = ExecuteActionRequest((Step(1, 0, 1),))
        assert await connection.send(move, ticket=checked)
        await connection.request(SetAngleUnitRequest(1, 1))
        with pytest.raises(UnitsChanged, match="an angle unit was set while it was checked"):
            await connection.send(move, ticket=checked)
        assert await connection.send(move, ticket=checked.checked(connection.units_sent))
        assert len(board.executed_of(ExecuteActionRequest)) == 2


# --- values are checked first -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("packet", "words"),
    [
        (QueryServoRequest(256), r"QueryServoRequest\.servo_id.*256.*0\.\.255"),
        (WriteProjectIDRequest(2**31), r"WriteProjectIDRequest\.project_id.*2147483648"),
        (AddActionRequest(1, "x" * 33), r"AddActionRequest\.action_caption"),
    ],
)
async def test_what_does_not_fit_is_refused_before_anything_is_sent(packet: Request[Any], words: str) -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        with pytest.raises(EncodeError, match=words):
            await connection.request(packet)
        with pytest.raises(EncodeError, match="interval"):
            await connection.send(ExecuteActionRequest((Step(1, 0, -1),)))
        assert board.sent == []
        await connection.request(PROJECT)


async def test_what_a_preparation_raises_reaches_the_caller_and_nothing_is_sent() -> None:
    board = PipedBoard()

    async def prepare(packet: Packet, ticket: Ticket) -> None:
        raise RequestTimeout("which board it is could not be asked", packet)

    async with connected(board) as connection:
        connection.preparations = (prepare,)
        with pytest.raises(RequestTimeout, match="which board it is"):
            await connection.request(WriteProjectIDRequest(5), timeout=1)
        assert not board.executed_of(WriteProjectIDRequest)
