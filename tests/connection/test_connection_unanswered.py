"""Requests whose response is lost: what is sent again, and what is not."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink.errors import OutcomeUnknown, RequestTimeout
from servolink.protocol import (
    ALL_SERVOS,
    AddActionRequest,
    ButtonEventResponse,
    ClearAllDataRequest,
    DeleteActionRequest,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryServoListRequest,
    QueryServoRequest,
    Request,
    SendDummyDataRequest,
    SetActiveJoystickTableRequest,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    Step,
    SubscribeButtonEventRequest,
    TransmissionModeSettingRequest,
    WriteProjectIDRequest,
)
from servolink.testing import Fate
from tests.client.piped_board import LATENCY, LOST, SWALLOWED, PipedBoard, connected, late, now
from tests.connection.unanswered import FENCE_KINDS, LIST, PROJECT, kinds

# --- queries ------------------------------------------------------------------------------------------------------


async def test_a_lost_query_is_sent_again_after_a_quarter_of_a_second_without_a_fence() -> None:
    board = PipedBoard()
    board.plan(QueryProjectIDRequest, LOST)
    async with connected(board) as connection:
        begun = now()
        await connection.request(PROJECT)
        assert now() == pytest.approx(begun + 0.25 + LATENCY)
        assert (connection.stats.retries, connection.stats.timeouts, connection.stats.fences) == (1, 1, 0)


async def test_a_query_is_repeated_ever_more_slowly_until_the_patience_ends() -> None:
    board = PipedBoard()
    board.plan(QueryServoListRequest, *[LOST] * 9)
    async with connected(board) as connection:
        asyncio.get_running_loop().call_later(1.0, board.speak, ButtonEventResponse(1, 1))
        begun = now()
        with pytest.raises(RequestTimeout, match=r"in 3\.0 s \(8 tries\)"):
            await connection.request(LIST)
        assert now() == pytest.approx(begun + 3)
        sent = [at - begun for at in board.sent_of(QueryServoListRequest)]
        # A fence goes out before the fourth one; its response shows that the line is quick.
        assert sent == pytest.approx([0, 0.25, 0.5, 0.88, 1.17, 1.53, 2.01, 2.64], abs=0.01)
        assert connection.stats.retries == 7
        assert connection.stats.timeouts == 8


async def test_the_first_response_to_any_of_its_sendings_counts() -> None:
    board = PipedBoard()
    board.plan(QueryServoListRequest, late(0.3), late(0.3))
    async with connected(board) as connection:
        begun = now()
        assert len((await connection.request(LIST)).servo_id_list) == 4
        assert now() == pytest.approx(begun + 0.3)
        await asyncio.sleep(1)
        assert (connection.stats.late_responses, connection.stats.unsolicited) == (1, 0)
        assert connection.stats.mismatched == 0


async def test_the_response_to_its_last_sending_holds_nobody_up() -> None:
    """An older sending has got the response, which most likely was the one to the last."""
    board = PipedBoard()
    board.plan(QueryServoListRequest, late(0.3), LOST)
    async with connected(board) as connection:
        await connection.request(LIST)
        begun = now()
        await connection.request(ClearAllDataRequest())
        assert now() == pytest.approx(begun + 2 * LATENCY)  # a fence comes first


@pytest.mark.parametrize("depth", [1, 4])
async def test_the_time_of_a_request_counts_from_when_the_board_comes_to_it(depth: int) -> None:
    board = PipedBoard()
    queries: list[Request[Any]] = [PROJECT, LIST, QueryServoRequest(1), QueryMemorySizeRequest()]
    for number, query in enumerate(queries):
        board.plan(type(query), late(0.2 * (number + 1 if depth > 1 else 1)))
    async with connected(board, depth=depth) as connection:
        await asyncio.gather(*map(connection.request, queries))
        assert connection.stats.timeouts == 0
        assert len(board.sent) == 4


async def test_two_responses_in_one_chunk_are_one_response_and_a_late_one() -> None:
    board = PipedBoard()
    board.plan(QueryServoListRequest, SWALLOWED, SWALLOWED)
    async with connected(board) as connection:
        asking = asyncio.create_task(connection.request(LIST))
        await asyncio.sleep(0.3)
        answer = board.codec.encode(board.codec.decode(20011, bytes((1, 7))))
        board.deliver(answer + board.codec.encode(board.codec.decode(20011, bytes((1, 8)))))
        assert (await asking).servo_id_list == (7,)
        assert connection.stats.late_responses == 1


@pytest.mark.parametrize("lost", [0.1, 0.3])
async def test_on_a_live_line_that_loses_much_no_query_fails(lost: float) -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        for number in range(600):
            board.plan(QueryServoListRequest, LOST if (number * 7919 % 1000) < 1000 * lost else Fate())
        for _ in range(300):
            await connection.request(LIST)
        assert connection.stats.retries > 100 * lost


async def test_a_slow_board_is_sent_what_was_measured_for_it() -> None:
    """A board that takes 0.4 s for each response is asked once each time, from the second time on."""
    board = PipedBoard(usual=late(0.4))
    async with connected(board) as connection:
        board.plan(QueryServoListRequest, late(0.2))
        for _ in range(5):
            await connection.request(LIST)
        assert len(board.sent_of(QueryServoListRequest)) == 5


# --- settings that may be repeated --------------------------------------------------------------------------------

SETTINGS: list[Request[Any]] = [
    TransmissionModeSettingRequest(1),
    SetAngleUnitRequest(ALL_SERVOS, 0),
    SubscribeButtonEventRequest(1),
    SetActiveJoystickTableRequest(1),
    WriteProjectIDRequest(3),
]
COMMANDS: list[Request[Any]] = [
    AddActionRequest(1, "a"),
    DeleteActionRequest(1),
    ExecuteMacroRequest(1),
    SetServoParameterRequest(ALL_SERVOS, 1, 1),
    ClearAllDataRequest(),
]


def name_of(packet: object) -> str:
    return type(packet).__name__


@pytest.mark.parametrize("packet", SETTINGS, ids=name_of)
@pytest.mark.parametrize("fate", [LOST, SWALLOWED])
async def test_a_setting_that_has_the_same_effect_twice_is_repeated(packet: Request[Any], fate: Fate) -> None:
    board = PipedBoard()
    board.plan(type(packet), fate, fate)
    async with connected(board) as connection:
        assert await connection.request(packet)
        assert len(board.sent_of(type(packet))) == 3
        assert connection.stats.fences == 0


async def test_of_a_setting_that_is_never_answered_the_outcome_is_unknown() -> None:
    board = PipedBoard()
    board.usual_of[WriteProjectIDRequest] = SWALLOWED
    async with connected(board) as connection:
        asyncio.get_running_loop().call_later(1.0, board.speak, ButtonEventResponse(1, 1))
        begun = now()
        with pytest.raises(OutcomeUnknown, match=r"not answered in 3\.0 s"):
            await connection.request(WriteProjectIDRequest(3))
        assert now() == pytest.approx(begun + 3)


# --- commands -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("packet", COMMANDS, ids=name_of)
@pytest.mark.parametrize("fate", [LOST, SWALLOWED])
async def test_what_changes_the_board_is_sent_once_and_a_fence_shows_that_its_outcome_is_unknown(
    packet: Request[Any], fate: Fate
) -> None:
    board = PipedBoard()
    board.plan(type(packet), fate)
    async with connected(board) as connection:
        begun = now()
        with pytest.raises(OutcomeUnknown) as caught:
            await connection.request(packet)
        assert now() == pytest.approx(begun + 1.0 + LATENCY)
        assert caught.value.request == packet
        await asyncio.sleep(5)
        await connection.request(PROJECT)
        assert len(board.sent_of(type(packet))) == 1
        assert connection.stats.fences == 1


@pytest.mark.parametrize("packet", COMMANDS, ids=name_of)
async def test_the_late_result_of_a_command_arrives(packet: Request[Any]) -> None:
    board = PipedBoard()
    board.plan(type(packet), late(1.5))
    async with connected(board) as connection:
        begun = now()
        assert await connection.request(packet)
        assert now() == pytest.approx(begun + 1.5)
        assert len(board.sent_of(type(packet))) == 1


async def test_movements_are_sent_once_and_return_when_sent() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        begun = now()
        await connection.send(ExecuteActionRequest((Step(1, 10, 100),)))
        await connection.send(ExecuteActionExRequest(4))
        assert now() == begun
        await asyncio.sleep(10)
        assert [type(packet) for _, packet in board.executed] == [ExecuteActionRequest, ExecuteActionExRequest]


# --- packets without a response -----------------------------------------------------------------------------------


@pytest.mark.parametrize("depth", [1, 8])
async def test_after_four_packets_without_a_response_the_board_must_answer_before_the_next(depth: int) -> None:
    board = PipedBoard(usual=late(0.1))
    async with connected(board, depth=depth) as connection:
        for _ in range(9):
            await connection.send(SendDummyDataRequest(b"x"))
        sent = [kind in FENCE_KINDS for kind in kinds(board)]
        assert sent == [False] * 4 + [True] + [False] * 4 + [True] + [False]
        if depth == 1:
            assert board.sent[5][0] == pytest.approx(board.sent[4][0] + 0.1)


async def test_any_response_shows_that_the_board_keeps_up() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        for _ in range(5):
            for _ in range(3):
                await connection.send(SendDummyDataRequest(b"x"))
            await connection.request(PROJECT)
        assert connection.stats.fences == 0
