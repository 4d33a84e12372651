"""Opening: nothing that an earlier program is owed is taken for a response, and a silent board is explained."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from random import Random
from typing import Any

import pytest

from servolink.connection.connection import Connection
from servolink.connection.opening import FENCES
from servolink.errors import ConnectionLost, OpenError, OutcomeUnknown, RequestTimeout
from servolink.protocol.editing import (
    AddActionRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    WriteProjectIDRequest,
)
from servolink.protocol.joystick import ButtonEventResponse, QueryActiveJoystickTableRequest
from servolink.protocol.packet import Packet, Request
from servolink.protocol.servos import (
    ALL_SERVOS,
    QueryServoListRequest,
    QueryServoListResponse,
    SetServoParameterRequest,
)
from servolink.protocol.settings import (
    QueryMemorySizeRequest,
    TransmissionModeSettingRequest,
)
from tests.client.fake_board import (
    LATENCY,
    LOST,
    SWALLOWED,
    FakeBoard,
    Fate,
    connected,
    late,
    lie,
    now,
    turns_of_the_loop,
)
from tests.virtual_time import run

FENCE_KINDS = tuple(type(fence) for fence in FENCES)
LIST = QueryServoListRequest()
STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)


@asynccontextmanager
async def opening(board: FakeBoard, *, seed: int = 1, **options: Any) -> AsyncIterator[Connection]:
    """Open a connection whose handshake begins when somebody wants it."""
    async with connected(board, handshake=True, random=Random(seed), **options) as connection:
        yield connection


async def owe(board: FakeBoard, *requests: tuple[Request[Any], Fate]) -> None:
    """Send what a program sends that is killed before it is answered."""
    for request, fate in requests:
        board.plan(type(request), fate)
        await board.send(board.codec.encode(request))
    board.sent.clear()


def kinds(board: FakeBoard) -> list[type[Packet]]:
    return [type(packet) for _, packet in board.sent]


# --- a good board -------------------------------------------------------------------------------------------------


def test_a_handshake_takes_six_short_queries_and_nothing_else() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            begun = now()
            await connection.shake_hands()
            assert now() == pytest.approx(begun + 6 * LATENCY)
            assert len(board.sent) == 6
            assert set(kinds(board)) <= set(FENCE_KINDS)
            assert kinds(board).count(kinds(board)[-1]) == 1
            await connection.shake_hands()  # once is enough
            assert len(board.sent) == 6

    run(main())


def test_its_queries_are_drawn_anew_each_time() -> None:
    async def main(seed: int) -> tuple[type[Packet], ...]:
        board = FakeBoard()
        async with opening(board, seed=seed) as connection:
            await connection.shake_hands()
        return tuple(kinds(board))

    assert len({run(main(seed)) for seed in range(20)}) > 15


def test_the_first_request_brings_it_about() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            assert len((await connection.request(LIST)).servo_id_list) == 4
            assert set(kinds(board)[:6]) <= set(FENCE_KINDS)
            assert kinds(board)[6:] == [QueryServoListRequest]

    run(main())


def test_all_who_ask_meanwhile_wait_for_the_same_one() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board, depth=4) as connection:
            await asyncio.gather(
                connection.shake_hands(),
                connection.request(LIST),
                connection.request(QueryProjectIDRequest()),
                connection.shake_hands(),
            )
            assert len(board.sent) == 8

    run(main())


def test_who_is_cancelled_leaves_it_to_the_others() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            first = asyncio.create_task(connection.shake_hands())
            second = asyncio.create_task(connection.request(LIST))
            await asyncio.sleep(2.5 * LATENCY)
            first.cancel()
            assert len((await second).servo_id_list) == 4
            assert first.cancelled()
            assert len(board.sent) == 7

    run(main())


def test_one_that_nobody_waits_for_any_more_serves_the_next() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            asking = asyncio.create_task(connection.request(LIST))
            await asyncio.sleep(2.5 * LATENCY)
            asking.cancel()
            await asyncio.sleep(1)
            assert len(board.sent) == 6
            await connection.request(LIST)
            assert len(board.sent) == 7

    run(main())


def test_a_time_limit_counts_meanwhile() -> None:
    async def main() -> None:
        board = FakeBoard(usual=late(0.2))
        async with opening(board) as connection:
            begun = now()
            with pytest.raises(RequestTimeout, match=r"not sent in 0\.5 s"):
                await connection.request(LIST, timeout=0.5)
            assert now() == pytest.approx(begun + 0.5)

    run(main())


@pytest.mark.parametrize("seed", range(30))
def test_what_is_lost_is_asked_again_and_its_late_response_is_not_taken_for_one_to_a_request(seed: int) -> None:
    async def main() -> None:
        board = FakeBoard()
        chance = Random(seed)
        for kind in FENCE_KINDS:
            board.plan(kind, *(chance.choice((Fate(), LOST, SWALLOWED, late(0.4), late(1.1))) for _ in range(3)))
        async with opening(board, seed=seed, patience=10) as connection:
            await connection.shake_hands()
            board.forget_plans()
            for number in range(1, 6):
                board.plan(QueryProjectIDRequest, lie(QueryProjectIDResponse(number)))
                assert (await connection.request(QueryProjectIDRequest())).project_id == number
            assert connection.stats.reopenings == 0

    run(main())


# --- what an earlier program is owed ------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(40))
def test_up_to_five_responses_to_an_earlier_program_are_never_taken_for_ours(seed: int) -> None:
    async def main() -> None:
        board = FakeBoard()
        chance = Random(1000 + seed)
        owed = [
            (chance.choice([*FENCES, LIST]), Fate(after=chance.uniform(0, 2), says=None))
            for _ in range(chance.randint(1, 4))
        ]
        wrong = (LIST, Fate(after=chance.uniform(0, 2), says=QueryServoListResponse((99,))))
        async with opening(board, seed=seed) as connection:
            await owe(board, *owed, wrong)
            assert (await connection.request(LIST)).servo_id_list == (1, 2, 3, 4)
            assert connection.stats.late_responses == connection.stats.unsolicited == 0

    run(main())


def test_a_response_that_does_not_fit_makes_it_longer() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            await owe(board, (LIST, late(0.006)))
            await connection.shake_hands()
            assert len(board.sent) >= 10

    run(main())


def test_without_it_the_response_to_an_earlier_program_is_taken_for_ours() -> None:
    """What the handshake is for."""

    async def main() -> None:
        board = FakeBoard()
        async with connected(board) as connection:
            await owe(board, (LIST, Fate(after=0.1, says=QueryServoListResponse((99,)))))
            assert (await connection.request(LIST)).servo_id_list == (99,)

    run(main())


def test_what_comes_before_the_handshake_opens_nothing_twice() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            board.speak(QueryProjectIDResponse(5))
            await connection.shake_hands()
            assert connection.stats.reopenings == 0
            assert len(board.sent) == 6

    run(main())


# --- button events, stops -----------------------------------------------------------------------------------------


def test_button_events_arrive_meanwhile_and_disturb_nothing() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            events: list[ButtonEventResponse] = []
            connection.answers.on_event = events.append
            for number in range(20):
                asyncio.get_running_loop().call_later(number / 1000, board.speak, ButtonEventResponse(number, 1))
            asyncio.get_running_loop().call_later(0.003, board.speak, LIST)  # nothing that a board sends
            await connection.shake_hands()
            assert len(events) == 20
            assert len(board.sent) == 6

    run(main())


def test_a_stop_goes_at_once_and_the_handshake_begins_again() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            opened = asyncio.create_task(connection.shake_hands())
            await asyncio.sleep(2.5 * LATENCY)
            begun = now()
            await connection.send_stop(STOP)
            assert board.sent[-1] == (begun, STOP)
            await opened
            at = kinds(board).index(SetServoParameterRequest)
            assert len(kinds(board)[at + 1 :]) >= 6
            begun = now()
            assert (await connection.request(SetServoParameterRequest(1, 1, 1))).servo_id == 1
            assert connection.stats.fences == 0  # the handshake has settled the stop

    run(main())


def test_a_stop_before_it_waits_for_nothing() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            await connection.send_stop(STOP)
            assert kinds(board) == [SetServoParameterRequest]
            await connection.request(LIST)
            assert len(board.sent) == 8

    run(main())


def test_a_stop_reaches_a_board_that_answers_nothing() -> None:
    async def main() -> None:
        board = FakeBoard(usual=SWALLOWED)
        async with opening(board) as connection:
            opened = asyncio.create_task(connection.shake_hands())
            for _ in range(3):
                await asyncio.sleep(0.7)
                begun = now()
                await connection.send_stop(STOP)
                assert now() == begun
            with pytest.raises(OpenError, match="no board answers"):
                await opened
            assert board.executed_of(SetServoParameterRequest) == [STOP] * 3

    run(main())


# --- silence, and what explains it --------------------------------------------------------------------------------


@pytest.mark.parametrize("patience", [0.5, 3.0, 10.0])
def test_a_silent_board_is_given_up_after_the_patience_and_five_tries(patience: float) -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with opening(board, patience=patience) as connection:
            begun = now()
            with pytest.raises(OpenError) as caught:
                await connection.shake_hands()
            assert now() == pytest.approx(begun + patience)
            assert sum(kind in FENCE_KINDS for kind in kinds(board)) >= 5
            text = str(caught.value)
            causes = ["fake://board is open, but no board answers", "switched on", "port", "data cable", "baud rate"]
            positions = [text.index(cause) for cause in [*causes, "byte_order=big", "servolink doctor"]]
            assert positions == sorted(positions)

    run(main())


def test_bytes_without_a_frame_are_explained_by_byte_order_and_baud_rate() -> None:
    async def main() -> None:
        board = FakeBoard(usual=Fate(mangle=lambda frame: bytes(255 - byte for byte in frame)))
        async with opening(board) as connection:
            begun = now()
            with pytest.raises(OpenError, match=r"sends bytes, but no frame .*byte_order=big.* baud rate.*doctor"):
                await connection.shake_hands()
            assert now() == pytest.approx(begun + 3)

    run(main())


@pytest.mark.parametrize(("spoken_at", "given_up_at"), [((1,), 7), ((1, 2.5, 5, 9), 12)])
def test_a_board_that_answers_too_little_has_more_time_and_is_told_from_a_silent_one(
    spoken_at: tuple[float, ...], given_up_at: float
) -> None:
    """Twice the patience after its latest response, and four times that in all."""

    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with opening(board) as connection:
            begun = now()
            for seconds in spoken_at:
                asyncio.get_running_loop().call_later(seconds, board.speak, QueryServoListResponse((1,)))
            with pytest.raises(OpenError, match=r"answers, but too little .*the line is bad, or the board is busy"):
                await connection.shake_hands()
            assert now() == pytest.approx(begun + given_up_at)

    run(main())


def test_a_board_that_only_sends_button_events_is_not_a_silent_one() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with opening(board) as connection:
            asyncio.get_running_loop().call_later(0.1, board.speak, ButtonEventResponse(1, 1))
            with pytest.raises(OpenError, match="answers, but too little"):
                await connection.shake_hands()
            assert board.sent_of(TransmissionModeSettingRequest) == []

    run(main())


def test_whoever_waits_for_it_and_whoever_comes_later_is_told_why_it_failed() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with opening(board) as connection:
            errors = await asyncio.gather(
                connection.request(LIST),
                connection.shake_hands(),
                connection.request(AddActionRequest(1)),
                return_exceptions=True,
            )
            assert [type(error) for error in errors] == [ConnectionLost, OpenError, ConnectionLost]
            assert "no board answers" in str(errors[0])
            assert str(errors[0]).count("fake://board") == 1
            with pytest.raises(ConnectionLost, match="no board answers"):
                await connection.request(LIST)
            with pytest.raises(ConnectionLost, match="no board answers"):
                await connection.shake_hands()
            assert AddActionRequest not in kinds(board)

    run(main())


# --- transmission mode --------------------------------------------------------------------------------------------


def test_a_board_in_the_other_mode_is_woken_once() -> None:
    class Asleep(FakeBoard):
        """It answers nothing until mode 1 is set."""

        def _take(self, packet: Packet, frame: bytes) -> None:
            if isinstance(packet, TransmissionModeSettingRequest):
                self.usual = Fate()
            super()._take(packet, frame)

    async def main() -> None:
        board = Asleep(usual=LOST)
        async with opening(board) as connection:
            await connection.shake_hands()
            assert board.executed_of(TransmissionModeSettingRequest) == [TransmissionModeSettingRequest(1)]
            assert kinds(board).index(TransmissionModeSettingRequest) == 2
            await connection.request(LIST)
            assert connection.stats.unsolicited == 0

    run(main())


def test_a_board_that_answers_keeps_its_mode() -> None:
    async def main() -> None:
        board = FakeBoard()
        for kind in FENCE_KINDS:
            board.plan(kind, Fate(), LOST, LOST, LOST)
        async with opening(board) as connection:
            await connection.shake_hands()
            assert TransmissionModeSettingRequest not in kinds(board)

    run(main())


def test_the_mode_is_not_touched_if_nobody_wants_that() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with opening(board, wake=False) as connection:
            with pytest.raises(OpenError):
                await connection.shake_hands()
            assert TransmissionModeSettingRequest not in kinds(board)

    run(main())


# --- queries that a board does not support ------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize(
    "missing",
    [
        [QueryMemorySizeRequest],
        [QueryProjectIDRequest, QueryActiveJoystickTableRequest],
    ],
)
def test_a_kind_that_is_never_answered_is_left_out_and_used_for_no_fence(
    missing: list[type[Packet]], seed: int
) -> None:
    async def main() -> None:
        board = FakeBoard()
        for kind in missing:
            board.usual_of[kind] = LOST
        async with opening(board, seed=seed) as connection:
            begun = now()
            await connection.shake_hands()
            assert now() < begun + 4.5
            dropped = {type(fence) for fence in FENCES} - {type(fence) for fence in connection._sender.fences}
            assert dropped <= set(missing)
            assert {kind for kind in missing if kinds(board).count(kind) >= 4} <= dropped

    run(main())


@pytest.mark.parametrize("seed", range(6))
def test_a_board_with_one_kind_only_is_opened_when_the_line_was_quiet_and_that_is_said(
    seed: int, caplog: pytest.LogCaptureFixture
) -> None:
    async def main() -> None:
        board = FakeBoard()
        for kind in FENCE_KINDS[:-1]:
            board.usual_of[kind] = LOST
        async with opening(board, seed=seed, patience=10) as connection:
            await owe(board, (LIST, Fate(after=8, says=QueryServoListResponse((99,)))))
            board.speak(ButtonEventResponse(1, 1))
            assert (await connection.request(LIST)).servo_id_list == (1, 2, 3, 4)
            quiet, asked = board.answered_at[-3:-1]
            assert asked - quiet >= 10

    run(main())
    assert [message.startswith("fake://board answers only one kind") for message in caplog.messages] == [True]


def test_a_board_that_falls_silent_is_not_taken_for_one_with_one_kind_only() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with opening(board) as connection:
            asyncio.get_running_loop().call_later(0.1, board.speak, QueryProjectIDResponse(1))
            with pytest.raises(OpenError, match="answers, but too little"):
                await connection.shake_hands()

    run(main())


def test_a_second_response_of_the_only_kind_is_not_taken_for_one_to_a_request() -> None:
    async def main() -> None:
        board = FakeBoard()
        for kind in FENCE_KINDS[1:]:
            board.usual_of[kind] = LOST
        async with opening(board, patience=10) as connection:
            opened = asyncio.create_task(connection.shake_hands())
            await asyncio.sleep(13)
            board.plan(QueryProjectIDRequest, late(0.3), Fate(after=0.5, says=QueryProjectIDResponse(99)))
            await opened
            board.plan(QueryProjectIDRequest, lie(QueryProjectIDResponse(7)))
            assert (await connection.request(QueryProjectIDRequest())).project_id == 7

    run(main())


@pytest.mark.parametrize("lost", [1, 3, 4])
def test_the_only_kind_has_to_be_answered_once_more_when_the_line_was_quiet(lost: int) -> None:
    async def main() -> None:
        board = FakeBoard()
        for kind in FENCE_KINDS[1:]:
            board.usual_of[kind] = LOST
        async with opening(board, patience=10) as connection:
            opened = asyncio.create_task(connection.shake_hands())
            await asyncio.sleep(13)
            assert connection._opening is not None
            assert not opened.done()
            board.plan(FENCE_KINDS[0], *[LOST] * lost)
            if lost == 4:
                with pytest.raises(OpenError, match="answers, but too little"):
                    await opened
            else:
                await opened
                board.plan(QueryProjectIDRequest, lie(QueryProjectIDResponse(7)))
                assert (await connection.request(QueryProjectIDRequest())).project_id == 7

    run(main())


def test_a_connection_that_is_lost_while_it_waits_for_quiet_is_lost() -> None:
    async def main() -> None:
        board = FakeBoard()
        for kind in FENCE_KINDS[:-1]:
            board.usual_of[kind] = LOST
        async with opening(board, patience=20) as connection:
            opened = asyncio.create_task(connection.shake_hands())
            await asyncio.sleep(15)
            assert not opened.done()
            begun = now()
            board.vanish()
            with pytest.raises(ConnectionLost, match="device disconnected"):
                await opened
            assert now() == begun

    run(main())


# --- lost meanwhile -----------------------------------------------------------------------------------------------


def test_a_connection_that_is_lost_meanwhile_is_lost_for_all_who_wait_at_once() -> None:
    async def main() -> None:
        board = FakeBoard(usual=late(0.1))
        async with opening(board) as connection:
            waiting = asyncio.gather(connection.shake_hands(), connection.request(LIST), return_exceptions=True)
            await asyncio.sleep(0.25)
            begun = now()
            board.vanish()
            errors = await waiting
            assert now() == begun
            assert [type(error) for error in errors] == [ConnectionLost, ConnectionLost]
            assert all("device disconnected" in str(error) for error in errors)

    run(main())


def test_a_board_that_vanishes_while_it_is_asked_is_lost_with_the_reason() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            board.gone = OSError("write failed")
            with pytest.raises(ConnectionLost, match="write failed"):
                await connection.shake_hands()

    run(main())


def test_closing_ends_it() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with opening(board) as connection:
            opened = asyncio.create_task(connection.shake_hands())
            await asyncio.sleep(0.1)
            await connection.close()
            with pytest.raises(ConnectionLost, match="closed by this program"):
                await opened

    run(main())


def test_a_program_that_ends_meanwhile_is_quiet(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        connection = Connection(board, board.codec)
        await connection.open()
        asyncio.create_task(connection.shake_hands())  # noqa: RUF006 - it is to be left behind
        await turns_of_the_loop(3)

    asyncio.run(main())
    assert caplog.messages == []


# --- a response that nobody asked for -----------------------------------------------------------------------------


STRANGER = QueryProjectIDResponse(666)


def test_a_response_that_nobody_asked_for_opens_the_connection_again() -> None:
    """Then it was opened on the responses to another program, and whatever is under way is in doubt."""

    async def main() -> None:
        board = FakeBoard()
        async with opening(board, depth=2) as connection:
            await connection.shake_hands()
            board.sent.clear()
            board.plan(QueryServoListRequest, late(0.2))
            board.plan(AddActionRequest, late(0.2))
            query = asyncio.create_task(connection.request(LIST))
            command = asyncio.create_task(connection.request(AddActionRequest(1)))
            await asyncio.sleep(0.1)
            board.speak(STRANGER)
            assert len((await query).servo_id_list) == 4
            with pytest.raises(OutcomeUnknown):
                await command
            assert connection.stats.reopenings == 1
            assert board.executed_of(AddActionRequest) == [AddActionRequest(1)]
            assert len(board.sent_of(QueryServoListRequest)) == 2
            assert sum(kind in FENCE_KINDS for kind in kinds(board)) >= 6

    run(main())


def test_it_does_so_at_most_once_in_ten_seconds() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            await connection.shake_hands()
            reopenings = []
            for _ in range(25):
                board.speak(STRANGER)
                await asyncio.sleep(1)
                reopenings.append(connection.stats.reopenings)
            assert reopenings == [1] * 10 + [2] * 10 + [3] * 5
            assert connection.stats.unsolicited == 25
            assert (await connection.request(WriteProjectIDRequest(4))).result == 1

    run(main())


@pytest.mark.parametrize("packet", [QueryServoListResponse((1,)), QueryServoListRequest()])
def test_what_no_handshake_could_have_been_deceived_by_opens_nothing(packet: Packet) -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            await connection.shake_hands()
            board.speak(packet)
            await asyncio.sleep(1)
            assert connection.stats.reopenings == 0
            assert connection.stats.unsolicited == 1

    run(main())


def test_after_the_end_it_opens_nothing() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            await connection.shake_hands()
            sent = len(board.sent)
            board.vanish()
            board.speak(STRANGER)
            await asyncio.sleep(1)
            assert connection.stats.reopenings == 0
            assert len(board.sent) == sent

    run(main())


def test_a_stop_waits_for_no_second_opening_either() -> None:
    async def main() -> None:
        board = FakeBoard()
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

    run(main())


def test_a_second_opening_that_fails_ends_the_connection() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with opening(board) as connection:
            await connection.shake_hands()
            board.usual = LOST
            asking = asyncio.create_task(connection.request(LIST))
            await asyncio.sleep(0.1)
            board.speak(STRANGER)
            with pytest.raises(ConnectionLost, match="no board answers"):
                await asking
            assert connection.answers.ended is not None

    run(main())
