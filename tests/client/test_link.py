"""Link: what is sent, when, how often, and what the caller is told."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink.errors import ConnectionLost, DecodeError, EncodeError, OutcomeUnknown, RequestTimeout
from servolink.protocol.editing import (
    AddActionRequest,
    AddActionResponse,
    DeleteActionRequest,
    ExecuteMacroRequest,
    QueryActionListRequest,
    QueryActionListResponse,
    QueryActionRequest,
    QueryActionResponse,
    QueryMacroRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from servolink.protocol.packet import Request
from servolink.protocol.servos import (
    ALL_SERVOS,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoRequest,
    SetServoParameterRequest,
    Step,
)
from servolink.protocol.settings import (
    ClearAllDataRequest,
    QueryMemorySizeRequest,
    QueryRemainPowerRequest,
    QueryRemainPowerResponse,
    SendDummyDataRequest,
)
from tests.client.fake_board import LATENCY, LOST, SWALLOWED, FakeBoard, Fate, late, lie, linked, now, turns_of_the_loop
from tests.virtual_time import run

PROJECT = QueryProjectIDRequest()


def cut_content(frame: bytes) -> bytes:
    """Return a frame with right length and sum whose count field says one more than there is."""
    content = bytearray(frame[8:-1])
    content[0] += 1
    body = frame[:8] + bytes(content)
    return body + bytes((sum(body) & 0xFF,))


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
            assert link.stats.late_replies == 0

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
            causes = ["nothing came at all", "is the board on", "is this its port", "data cable", "baud rate"]
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


def test_a_damaged_answer_to_a_change_leaves_its_outcome_unknown() -> None:
    """No reply to a change can be damaged within a right sum, as all have a fixed length: so the length lies."""

    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, Fate(mangle=cut_content))
        async with linked(board) as link:
            begun = now()
            with pytest.raises(OutcomeUnknown, match="bytes that make no packet") as caught:
                await link.request(Changing())
            assert isinstance(caught.value.__cause__, DecodeError)
            assert now() - begun < 0.1
            assert len(board.sent) == 1

    class Changing(Request[QueryActionListResponse], frozen=True, gc=False):
        packet_id = QueryServoListRequest.packet_id
        section = "none"

    run(main())


# --- the end of the connection ------------------------------------------------------------------------------------


def test_everyone_who_waits_gets_the_first_cause() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with linked(board, window=2) as link:
            waiting = asyncio.gather(
                *(link.request(packet) for packet in (PROJECT, QueryServoListRequest(), QueryRemainPowerRequest())),
                link.send(SendDummyDataRequest(b"x")),
                return_exceptions=True,
            )
            await asyncio.sleep(0.1)
            cause = OSError("device disconnected")
            begun = now()
            board.vanish(cause)
            errors = await waiting
            assert now() == begun
            assert len({id(error) for error in errors}) == 4
            for error in errors:
                assert isinstance(error, ConnectionLost)
                assert error.__cause__ is cause
                assert str(error) == "the connection to fake://board is gone: device disconnected"
            with pytest.raises(ConnectionLost, match="device disconnected"):
                await link.request(PROJECT)
            with pytest.raises(ConnectionLost, match="device disconnected"):
                await link.send(SendDummyDataRequest(b"x"))

    run(main())


def test_a_board_that_vanishes_mid_frame_is_lost_at_once() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryServoListRequest, Fate(mangle=lambda frame: frame[:7]))
        async with linked(board) as link:
            waiting = asyncio.create_task(link.request(QueryServoListRequest()))
            await asyncio.sleep(0.1)
            board.vanish()
            with pytest.raises(ConnectionLost, match="device disconnected"):
                await waiting

    run(main())


def test_a_board_that_vanishes_while_sending_is_lost_with_the_reason() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            ends: list[ConnectionLost] = []
            link.answers.on_end = ends.append
            board.gone = OSError("write failed")  # and nobody says so but the send itself
            with pytest.raises(ConnectionLost, match="write failed"):
                await link.request(PROJECT)
            with pytest.raises(ConnectionLost, match="write failed"):
                await link.send(SendDummyDataRequest(b"x"))
            assert len(ends) == 1
            assert ends[0].__cause__ is not None
            assert link.answers.ended is ends[0]

    run(main())


def test_closing_fails_who_waits_and_may_be_repeated() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with linked(board) as link:
            waiting = asyncio.create_task(link.request(PROJECT))
            await asyncio.sleep(0.1)
            await link.close()
            with pytest.raises(ConnectionLost, match="closed by this program"):
                await waiting
            await link.close()
            with pytest.raises(ConnectionLost, match="closed by this program"):
                await link.request(PROJECT)
        assert board.gone is not None

    run(main())


def test_a_turn_that_is_granted_as_the_connection_ends_is_not_used() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            first = asyncio.create_task(link.request(PROJECT))
            second = asyncio.create_task(link.request(QueryServoListRequest()))
            await turns_of_the_loop(2)
            loop = asyncio.get_running_loop()
            loop.call_later(LATENCY, lambda: loop.call_soon(board.vanish))
            await asyncio.wait((first, second))
            assert isinstance(second.exception(), ConnectionLost)
            assert board.sent_of(QueryServoListRequest) == []

    run(main())


# --- cancellation while sending -----------------------------------------------------------------------------------


def test_who_is_cancelled_while_sending_does_not_disturb_the_answer_of_the_next() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            board.taking = asyncio.Event()
            board.plan(WriteProjectIDRequest, lie(WriteProjectIDResponse(0)))
            cancelled = asyncio.create_task(link.request(WriteProjectIDRequest(1)))
            await turns_of_the_loop(3)
            following = asyncio.create_task(link.request(WriteProjectIDRequest(2)))
            cancelled.cancel()
            await turns_of_the_loop(3)
            assert cancelled.cancelled()
            assert len(board.sent) == 1
            board.taking = None
            assert (await following).result == 1
            assert board.executed_of(WriteProjectIDRequest) == [WriteProjectIDRequest(1), WriteProjectIDRequest(2)]

    run(main())


def test_a_cancelled_request_keeps_its_turn_until_it_is_answered() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(AddActionRequest, Fate(after=0.5, says=AddActionResponse(0)))
        async with linked(board) as link:
            cancelled = asyncio.create_task(link.request(AddActionRequest(1, "a")))
            await asyncio.sleep(0.1)
            cancelled.cancel()
            begun = now()
            assert (await link.request(AddActionRequest(2, "b"))).result == 1
            assert board.sent_of(AddActionRequest)[1] == pytest.approx(begun + 0.4)
            assert link.stats.fences == 0

    run(main())
