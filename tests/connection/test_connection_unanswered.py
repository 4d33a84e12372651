"""Requests that are not answered, late, or wrongly: what is sent again, when the caller is told, and what."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from typing import Any

import pytest

from servolink.connection.connection import Connection
from servolink.connection.opening import FENCES
from servolink.connection.slots import FENCES_ONLY
from servolink.errors import DecodeError, OutcomeUnknown, RequestTimeout
from servolink.protocol.editing import (
    AddActionRequest,
    DeleteActionRequest,
    ExecuteMacroRequest,
    QueryActionRequest,
    QueryProjectIDRequest,
    WriteProjectIDRequest,
)
from servolink.protocol.joystick import ButtonEventResponse, SetActiveJoystickTableRequest, SubscribeButtonEventRequest
from servolink.protocol.packet import Packet, Request
from servolink.protocol.records import Step
from servolink.protocol.servos import (
    ALL_SERVOS,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoRequest,
    SetAngleUnitRequest,
    SetServoParameterRequest,
)
from servolink.protocol.settings import (
    ClearAllDataRequest,
    QueryMemorySizeRequest,
    SendDummyDataRequest,
    TransmissionModeSettingRequest,
)
from tests.client.fake_board import LATENCY, LOST, SWALLOWED, FakeBoard, Fate, connected, late, now
from tests.virtual_time import run

PROJECT = QueryProjectIDRequest()
LIST = QueryServoListRequest()
FENCE_KINDS = tuple(type(fence) for fence in FENCES)


def cut_content(frame: bytes) -> bytes:
    """Return a frame with right length and sum whose count field says one more than there is."""
    content = bytearray(frame[8:-1])
    content[0] += 1
    body = frame[:8] + bytes(content)
    return body + bytes((sum(body) & 0xFF,))


async def ask_for_ever(connection: Connection, packet: Request[Any]) -> None:
    while True:
        await connection.request(packet)


# --- queries ------------------------------------------------------------------------------------------------------


def test_a_lost_query_is_sent_again_after_a_quarter_of_a_second_without_a_fence() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryProjectIDRequest, LOST)
        async with connected(board) as connection:
            begun = now()
            await connection.request(PROJECT)
            assert now() == pytest.approx(begun + 0.25 + LATENCY)
            assert (connection.stats.retries, connection.stats.timeouts, connection.stats.fences) == (1, 1, 0)

    run(main())


def test_a_query_is_repeated_ever_more_slowly_until_the_patience_ends() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, *[LOST] * 9)
        async with connected(board) as connection:
            asyncio.get_running_loop().call_later(1.0, board.speak, ButtonEventResponse(1, 1))
            begun = now()
            with pytest.raises(RequestTimeout, match=r"in 3\.0 s \(7 tries\)"):
                await connection.request(LIST)
            assert now() == pytest.approx(begun + 3)
            sent = [at - begun for at in board.sent_of(QueryServoListRequest)]
            # A fence goes out with the fourth one; its response shows that the line is quick.
            assert sent == pytest.approx([0, 0.25, 0.5, 0.88, 1.2, 1.69, 2.42], abs=0.01)
            assert connection.stats.retries == 6
            assert connection.stats.timeouts == 7

    run(main())


def test_the_first_response_to_any_of_its_sendings_counts() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, late(0.3), late(0.3))
        async with connected(board) as connection:
            begun = now()
            assert len((await connection.request(LIST)).servo_id_list) == 4
            assert now() == pytest.approx(begun + 0.3)
            await asyncio.sleep(1)
            assert (connection.stats.late_responses, connection.stats.unsolicited) == (1, 0)
            assert connection.stats.mismatched == 0

    run(main())


def test_the_response_to_its_last_sending_holds_nobody_up() -> None:
    """An older sending has got the response, which most likely was the one to the last."""

    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, late(0.3), LOST)
        async with connected(board) as connection:
            await connection.request(LIST)
            begun = now()
            await connection.request(ClearAllDataRequest())
            assert now() == pytest.approx(begun + 2 * LATENCY)  # a fence comes first

    run(main())


@pytest.mark.parametrize("depth", [1, 4])
def test_the_time_of_a_request_counts_from_when_the_board_comes_to_it(depth: int) -> None:
    async def main() -> None:
        board = FakeBoard()
        queries: list[Request[Any]] = [PROJECT, LIST, QueryServoRequest(1), QueryMemorySizeRequest()]
        for number, query in enumerate(queries):
            board.plan(type(query), late(0.2 * (number + 1 if depth > 1 else 1)))
        async with connected(board, depth=depth) as connection:
            await asyncio.gather(*map(connection.request, queries))
            assert connection.stats.timeouts == 0
            assert len(board.sent) == 4

    run(main())


def test_two_responses_in_one_chunk_are_one_response_and_a_late_one() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, SWALLOWED, SWALLOWED)
        async with connected(board) as connection:
            asking = asyncio.create_task(connection.request(LIST))
            await asyncio.sleep(0.3)
            answer = board.codec.encode(board.codec.decode(20011, bytes((1, 7))))
            board.deliver(answer + board.codec.encode(board.codec.decode(20011, bytes((1, 8)))))
            assert (await asking).servo_id_list == (7,)
            assert connection.stats.late_responses == 1

    run(main())


@pytest.mark.parametrize("lost", [0.1, 0.3])
def test_on_a_live_line_that_loses_much_no_query_fails(lost: float) -> None:
    async def main() -> None:
        board = FakeBoard()
        async with connected(board) as connection:
            for number in range(600):
                board.plan(QueryServoListRequest, LOST if (number * 7919 % 1000) < 1000 * lost else Fate())
            for _ in range(300):
                await connection.request(LIST)
            assert connection.stats.retries > 100 * lost

    run(main())


def test_a_slow_board_is_sent_what_was_measured_for_it() -> None:
    """A board that takes 0.4 s for each response is asked once each time, from the second time on."""

    async def main() -> None:
        board = FakeBoard(usual=late(0.4))
        async with connected(board) as connection:
            board.plan(QueryServoListRequest, late(0.2))
            for _ in range(5):
                await connection.request(LIST)
            assert len(board.sent_of(QueryServoListRequest)) == 5

    run(main())


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
def test_a_setting_that_has_the_same_effect_twice_is_repeated(packet: Request[Any], fate: Fate) -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(type(packet), fate, fate)
        async with connected(board) as connection:
            assert await connection.request(packet)
            assert len(board.sent_of(type(packet))) == 3
            assert connection.stats.fences == 0

    run(main())


def test_of_a_setting_that_is_never_answered_the_outcome_is_unknown() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.usual_of[WriteProjectIDRequest] = SWALLOWED
        async with connected(board) as connection:
            asyncio.get_running_loop().call_later(1.0, board.speak, ButtonEventResponse(1, 1))
            begun = now()
            with pytest.raises(OutcomeUnknown, match=r"not answered in 3\.0 s"):
                await connection.request(WriteProjectIDRequest(3))
            assert now() == pytest.approx(begun + 3)

    run(main())


# --- commands -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("packet", COMMANDS, ids=name_of)
@pytest.mark.parametrize("fate", [LOST, SWALLOWED])
def test_what_changes_the_board_is_sent_once_and_a_fence_shows_that_its_outcome_is_unknown(
    packet: Request[Any], fate: Fate
) -> None:
    async def main() -> None:
        board = FakeBoard()
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

    run(main())


@pytest.mark.parametrize("packet", COMMANDS, ids=name_of)
def test_the_late_result_of_a_command_arrives(packet: Request[Any]) -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(type(packet), late(1.5))
        async with connected(board) as connection:
            begun = now()
            assert await connection.request(packet)
            assert now() == pytest.approx(begun + 1.5)
            assert len(board.sent_of(type(packet))) == 1

    run(main())


def test_movements_are_sent_once_and_return_when_sent() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with connected(board) as connection:
            begun = now()
            await connection.send(ExecuteActionRequest((Step(1, 10, 100),)))
            await connection.send(ExecuteActionExRequest(4))
            assert now() == begun
            await asyncio.sleep(10)
            assert [type(packet) for _, packet in board.executed] == [ExecuteActionRequest, ExecuteActionExRequest]

    run(main())


# --- packets without a response -----------------------------------------------------------------------------------


def kinds(board: FakeBoard) -> list[type[Packet]]:
    return [type(packet) for _, packet in board.sent]


@pytest.mark.parametrize("depth", [1, 8])
def test_after_four_packets_without_a_response_the_board_must_answer_before_the_next(depth: int) -> None:
    async def main() -> None:
        board = FakeBoard(usual=late(0.1))
        async with connected(board, depth=depth) as connection:
            for _ in range(9):
                await connection.send(SendDummyDataRequest(b"x"))
            sent = [kind in FENCE_KINDS for kind in kinds(board)]
            assert sent == [False] * 4 + [True] + [False] * 4 + [True] + [False]
            if depth == 1:
                assert board.sent[5][0] == pytest.approx(board.sent[4][0] + 0.1)

    run(main())


def test_any_response_shows_that_the_board_keeps_up() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with connected(board) as connection:
            for _ in range(5):
                for _ in range(3):
                    await connection.send(SendDummyDataRequest(b"x"))
                await connection.request(PROJECT)
            assert connection.stats.fences == 0

    run(main())


# --- a board that is silent about one request ---------------------------------------------------------------------


def test_what_a_board_leaves_unanswered_while_it_answers_others_ends_with_a_timeout_that_says_so() -> None:
    async def main() -> None:
        board = FakeBoard()
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
            assert connection.answers.ended is None

    run(main())


def test_it_is_sent_again_three_times_without_a_pause_and_then_ever_more_slowly() -> None:
    async def main() -> None:
        board = FakeBoard()
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

    run(main())


def test_an_overdue_request_leaves_its_place_to_others() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.usual_of[AddActionRequest] = late(2.0)
        async with connected(board) as connection:
            with pytest.raises(OutcomeUnknown):
                await connection.request(AddActionRequest(1), timeout=0.1)
            begun = now()
            await connection.request(LIST)  # behind the late one, as the board answers in order
            assert now() == pytest.approx(begun + 1.9)

    run(main())


def test_while_very_much_is_overdue_only_fences_are_sent() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with connected(board) as connection:
            loop = asyncio.get_running_loop()
            for number in range(FENCES_ONLY):
                loop.call_later(0.005, board.speak, ButtonEventResponse(1, 1))
                with pytest.raises(RequestTimeout):
                    await connection.request(QueryActionRequest(number), timeout=0.01)
            assert connection._slots.overdue == len(board.sent) == FENCES_ONLY
            board.usual = Fate()
            await connection.request(QueryActionRequest(FENCES_ONLY))
            assert [type(packet) in FENCE_KINDS for _, packet in board.sent[FENCES_ONLY:]] == [True, False]
            assert connection._slots.overdue == 0

    run(main())


def test_then_no_repeat_is_sent_either() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
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

    run(main())


# --- `timeout` ----------------------------------------------------------------------------------------------------


def test_a_timeout_limits_the_whole_call_also_a_longer_one() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(AddActionRequest, late(4.0), SWALLOWED)
        async with connected(board) as connection:
            assert (await connection.request(AddActionRequest(1), timeout=5)).result
            begun = now()
            for kind in FENCE_KINDS:
                board.usual_of[kind] = LOST
            with pytest.raises(OutcomeUnknown, match=r"in 2\.0 s"):
                await connection.request(AddActionRequest(2), timeout=2)
            assert now() == pytest.approx(begun + 2)

    run(main())


@pytest.mark.parametrize("timeout", [0.05, 1.0, 2.5])
def test_a_timeout_counts_while_the_request_waits_for_others(timeout: float) -> None:
    async def main() -> None:
        board = FakeBoard()
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

    run(main())


def test_a_timeout_counts_on_when_the_request_has_its_turn() -> None:
    async def main() -> None:
        board = FakeBoard()
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

    run(main())


def test_a_timeout_ends_a_pause_between_two_tries() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.usual_of[QueryServoListRequest] = Fate(mangle=cut_content)
        async with connected(board) as connection:
            begun = now()
            with pytest.raises(DecodeError):
                await connection.request(LIST, timeout=0.3)
            assert now() == pytest.approx(begun + 0.3)

    run(main())


def test_a_timeout_counts_while_fences_are_sent() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with connected(board) as connection:
            with pytest.raises(OutcomeUnknown):
                await connection.request(AddActionRequest(1), timeout=0.1)
            begun = now()
            with pytest.raises(RequestTimeout, match="not sent"):
                await connection.request(AddActionRequest(1), timeout=0.7)
            assert now() == pytest.approx(begun + 0.7)

    run(main())


# --- what the caller is told --------------------------------------------------------------------------------------


def test_a_timeout_says_what_was_asked_of_whom_for_how_long_and_why_likely() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
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

    run(main())


def test_a_timeout_blames_the_settings_when_bytes_come_but_no_frame() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with connected(board, patience=0.5) as connection:
            board.deliver(b"login: ")
            with pytest.raises(
                RequestTimeout, match=r"byte order or baud rate .*; 7 received bytes were part of no frame"
            ):
                await connection.request(PROJECT)

    run(main())


def test_a_timeout_blames_the_line_when_the_board_has_answered_before() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, *[LOST] * 3)
        async with connected(board, patience=0.5) as connection:
            await connection.request(PROJECT)
            with pytest.raises(RequestTimeout, match=r"\(3 tries\): the board has answered before"):
                await connection.request(LIST)

    run(main())


# --- damaged responses --------------------------------------------------------------------------------------------


def test_a_late_response_after_damaged_ones_ends_the_call_at_once() -> None:
    async def main() -> None:
        board = FakeBoard()
        damaged = Fate(mangle=cut_content)
        board.plan(QueryServoListRequest, *[damaged] * 3, Fate(after=0.06, mangle=cut_content), late(0.4))
        async with connected(board) as connection:
            assert (await connection.request(LIST)).servo_id_list == (1, 2, 3, 4)
            assert len(board.sent) == 6
            assert now() == pytest.approx(board.sent[4][0] + 0.4)

    run(main())


def test_a_damaged_response_to_a_query_is_asked_for_again_at_once() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, *[Fate(mangle=cut_content)] * 3)
        async with connected(board) as connection:
            begun = now()
            assert (await connection.request(LIST)).servo_id_list == (1, 2, 3, 4)
            assert now() - begun < 0.1
            assert connection.stats.undecodable == 3
            assert connection.stats.timeouts == 0

    run(main())


def test_a_query_whose_responses_are_all_damaged_says_how_when_the_patience_ends() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.usual_of[QueryServoListRequest] = Fate(mangle=cut_content)
        async with connected(board) as connection:
            begun = now()
            with pytest.raises(DecodeError, match="QueryServoListResponse") as caught:
                await connection.request(LIST)
            assert now() == pytest.approx(begun + 3, abs=0.01)
            assert len(board.sent) <= 16
            assert caught.value.data == bytes((5, 1, 2, 3, 4))
            board.forget_plans()
            await connection.request(LIST)

    run(main())
