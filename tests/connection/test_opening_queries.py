"""Opening: queries that a board does not support, and openings for a response that nobody asked for."""

from __future__ import annotations

import asyncio

import pytest

from servolink.connection.opening import FENCES
from servolink.errors import ConnectionLost, OpenError, OutcomeUnknown
from servolink.protocol.editing import (
    AddActionRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    WriteProjectIDRequest,
)
from servolink.protocol.joystick import ButtonEventResponse, QueryActiveJoystickTableRequest
from servolink.protocol.packet import Packet
from servolink.protocol.servos import (
    QueryServoListRequest,
    QueryServoListResponse,
)
from servolink.protocol.settings import (
    QueryMemorySizeRequest,
)
from tests.client.fake_board import (
    LOST,
    SWALLOWED,
    FakeBoard,
    Fate,
    late,
    lie,
    now,
)
from tests.connection.openings import FENCE_KINDS, LIST, STOP, kinds, opening, owe
from tests.virtual_time import run

# --- queries that a board does not support ------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize(
    "missing",
    [
        [QueryMemorySizeRequest],
        [QueryProjectIDRequest, QueryActiveJoystickTableRequest],
    ],
)
async def test_a_kind_that_is_never_answered_is_left_out_and_used_for_no_fence(
    missing: list[type[Packet]], seed: int
) -> None:
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


async def test_a_board_that_falls_silent_is_not_taken_for_one_with_one_kind_only() -> None:
    board = FakeBoard(usual=LOST)
    async with opening(board) as connection:
        asyncio.get_running_loop().call_later(0.1, board.speak, QueryProjectIDResponse(1))
        with pytest.raises(OpenError, match="answers, but too little"):
            await connection.shake_hands()


async def test_a_second_response_of_the_only_kind_is_not_taken_for_one_to_a_request() -> None:
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


@pytest.mark.parametrize("lost", [1, 3, 4])
async def test_the_only_kind_has_to_be_answered_once_more_when_the_line_was_quiet(lost: int) -> None:
    board = FakeBoard()
    for kind in FENCE_KINDS[1:]:
        board.usual_of[kind] = LOST
    async with opening(board, patience=10) as connection:
        opened = asyncio.create_task(connection.shake_hands())
        await asyncio.sleep(13)
        assert connection.lifecycle.opening is not None
        assert not opened.done()
        board.plan(FENCE_KINDS[0], *[LOST] * lost)
        if lost == 4:
            with pytest.raises(OpenError, match="answers, but too little"):
                await opened
        else:
            await opened
            board.plan(QueryProjectIDRequest, lie(QueryProjectIDResponse(7)))
            assert (await connection.request(QueryProjectIDRequest())).project_id == 7


async def test_a_connection_that_is_lost_while_it_waits_for_quiet_is_lost() -> None:
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


# --- a response that nobody asked for -----------------------------------------------------------------------------


STRANGER = QueryProjectIDResponse(666)


async def test_a_response_that_nobody_asked_for_opens_the_connection_again() -> None:
    """Then it was opened on the responses to another program, and whatever is under way is in doubt."""
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


async def test_it_does_so_at_most_once_in_ten_seconds() -> None:
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


@pytest.mark.parametrize("packet", [QueryServoListResponse((1,)), QueryServoListRequest()])
async def test_what_no_handshake_could_have_been_deceived_by_opens_nothing(packet: Packet) -> None:
    board = FakeBoard()
    async with opening(board) as connection:
        await connection.shake_hands()
        board.speak(packet)
        await asyncio.sleep(1)
        assert connection.stats.reopenings == 0
        assert connection.stats.unsolicited == 1


async def test_after_the_end_it_opens_nothing() -> None:
    board = FakeBoard()
    async with opening(board) as connection:
        await connection.shake_hands()
        sent = len(board.sent)
        board.vanish()
        board.speak(STRANGER)
        await asyncio.sleep(1)
        assert connection.stats.reopenings == 0
        assert len(board.sent) == sent


async def test_a_stop_waits_for_no_second_opening_either() -> None:
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


async def test_a_second_opening_that_fails_ends_the_connection() -> None:
    board = FakeBoard()
    async with opening(board) as connection:
        await connection.shake_hands()
        board.usual = LOST
        asking = asyncio.create_task(connection.request(LIST))
        await asyncio.sleep(0.1)
        board.speak(STRANGER)
        with pytest.raises(ConnectionLost, match="no board answers"):
            await asking
        assert connection.ended is not None
