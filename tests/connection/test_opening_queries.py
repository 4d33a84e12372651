"""Opening: queries that a board does not support."""

from __future__ import annotations

import asyncio
from itertools import groupby, pairwise
from typing import Any

import pytest

from servolink.connection.opening import Opening, Phase
from servolink.errors import ConnectionLost, OpenError
from servolink.protocol import (
    AddActionRequest,
    ButtonEventResponse,
    Packet,
    QueryActionListRequest,
    QueryActionRequest,
    QueryActiveJoystickTableRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    TransmissionModeSettingRequest,
    WriteProjectIDRequest,
    encode_frame,
)
from servolink.testing import Fate
from tests.client.piped_board import LOST, SWALLOWED, PipedBoard, late, lie, now, opened
from tests.connection.openings import FENCE_KINDS, LIST, LIST_KINDS, STOP, kinds, opening, owe, without
from tests.tables import over
from tests.virtual_time import run

WRITE = WriteProjectIDRequest(4)


@over("seed", range(12))
@over(
    "missing",
    [
        [QueryMemorySizeRequest],
        [QueryProjectIDRequest, QueryActiveJoystickTableRequest],
    ],
)
async def test_a_kind_that_is_never_answered_is_left_out_and_used_for_no_fence(
    missing: list[type[Packet]], seed: int
) -> None:
    board = PipedBoard()
    for kind in missing:
        board.usual_of[kind] = LOST
    async with opening(board, seed=seed) as connection:
        begun = now()
        await connection.shake_hands()
        assert now() < begun + 4.5
        used = {type(fence) for fence in connection._sender.fences.queries}
        assert not used & {kind for kind in missing if kinds(board).count(kind) >= 4}
        assert len(used) >= 2


ONLY_ID = (*FENCE_KINDS[1:], *LIST_KINDS)
"""All that a board leaves unanswered that can only be opened by its project id."""
KNOWN_ONLY_ID: dict[str, Any] = {
    "unsupported": tuple(kind.__name__.removesuffix("Request") for kind in ONLY_ID),
    "patience": 10,
}


@pytest.mark.parametrize("seed", range(6))
def test_a_board_with_one_kind_only_is_opened_when_the_line_was_quiet_and_that_is_said(
    seed: int, caplog: pytest.LogCaptureFixture
) -> None:
    async def main() -> None:
        board = without(PipedBoard(), *ONLY_ID)
        async with opening(board, seed=seed, patience=10) as connection:
            await owe(board, (WRITE, Fate(delay=8)))
            board.speak(ButtonEventResponse(1, 1))
            await connection.shake_hands()
            assert any(after - before >= 10 for before, after in pairwise(board.answered_at))
            assert not connection.opener.is_proved
            assert connection.unsupported >= {"QueryMemorySize", "QueryServoList", "QueryMacroList"}
            assert (await connection.request(WRITE)).result == 1

    run(main())
    assert ["fake://board answers only" in message for message in caplog.messages] == [True]


@pytest.mark.parametrize(
    ("missing", "phases"),
    [
        ((), [Phase.HANDSHAKE, Phase.OPEN]),
        (ONLY_ID, [Phase.HANDSHAKE, Phase.SEARCH, Phase.QUIET, Phase.HANDSHAKE, Phase.OPEN]),
    ],
    ids=["all kinds", "one kind"],
)
async def test_an_opening_goes_through_the_phases_that_the_board_needs(
    missing: tuple[type[Packet], ...], phases: list[Phase]
) -> None:
    async with opening(without(PipedBoard(), *missing), patience=10) as connection:
        connection.opener.begin()
        under_way = connection.answers.opening
        assert isinstance(under_way, Opening)
        seen = [under_way.phase]
        while connection.answers.opening is not None:
            await asyncio.sleep(0.001)
            seen.append(under_way.phase)
        assert [phase for phase, _ in groupby(seen)] == phases


@pytest.mark.parametrize("seed", range(6))
async def test_old_firmware_is_opened_by_what_it_lists_and_works(seed: int) -> None:
    board = without(PipedBoard(), *FENCE_KINDS)
    async with opening(board, seed=seed) as connection:
        begun = now()
        await connection.shake_hands()
        assert now() < begun + 6
        assert connection.opener.is_proved
        word = kinds(board)[-6:]
        assert set(word) <= {QueryServoListRequest, QueryServoRequest}
        board.plan(QueryServoListRequest, LOST, LOST)
        assert [(await connection.request(LIST)).servo_id_list for _ in range(3)] == [(1, 2, 3, 4)] * 3
        board.plan(QueryServoRequest, SWALLOWED, LOST, LOST)
        assert len((await connection.request(QueryServoRequest(255))).servos) == 4
        sent = kinds(board)
    board.gone = None
    async with opening(board, unsupported=connection.unsupported, seed=seed) as connection:
        board.sent.clear()
        await connection.shake_hands()
        assert len(board.sent) == 7
        assert not set(kinds(board)) & set(FENCE_KINDS)
    assert set(FENCE_KINDS) & set(sent)


async def test_a_board_with_one_servo_is_opened_by_its_records_if_it_has_any() -> None:
    board = without(PipedBoard(servos=1), *FENCE_KINDS)
    async with opened(board) as client:
        await client.request(AddActionRequest(7, "wave"))
        await client.request(AddActionRequest(8, "bow"))
    board = without(board, *FENCE_KINDS)
    board.gone = None
    async with opening(board, unsupported=[kind.__name__.removesuffix("Request") for kind in FENCE_KINDS]) as link:
        board.sent.clear()
        await link.shake_hands()
        assert link.opener.is_proved
        assert {type(packet) for _, packet in board.sent} >= {QueryActionRequest, QueryActionListRequest}


async def test_a_list_in_old_mode_is_asked_for_again_behind_the_mode_setting() -> None:
    class Asleep(PipedBoard):
        """It answers nothing until mode 1 is set, and lacks the fences."""

        def _take(self, packet: Packet, frame: bytes) -> None:
            if isinstance(packet, TransmissionModeSettingRequest):
                self.usual = Fate()
            super()._take(packet, frame)

    board = without(Asleep(usual=LOST), *FENCE_KINDS)
    async with opening(board, unsupported=[kind.__name__.removesuffix("Request") for kind in FENCE_KINDS]) as link:
        await link.shake_hands()
        assert link.opener.woke


async def test_a_board_that_falls_silent_is_not_taken_for_one_with_one_kind_only() -> None:
    board = PipedBoard(usual=LOST)
    async with opening(board) as connection:
        asyncio.get_running_loop().call_later(0.1, board.speak, QueryProjectIDResponse(1))
        with pytest.raises(OpenError, match="answers, but too little"):
            await connection.shake_hands()


async def test_a_second_response_of_the_only_kind_is_not_taken_for_one_to_a_request() -> None:
    board = without(PipedBoard(), *ONLY_ID)
    async with opening(board, **KNOWN_ONLY_ID) as connection:
        board.plan(QueryProjectIDRequest, late(0.3), Fate(delay=0.5, says=QueryProjectIDResponse(99)))
        await connection.shake_hands()
        assert len(board.sent) == 2
        board.plan(QueryProjectIDRequest, lie(QueryProjectIDResponse(7)))
        assert (await connection.request(QueryProjectIDRequest())).project_id == 7


@pytest.mark.parametrize("lost", [1, 3, 40])
async def test_the_only_kind_has_to_be_answered_when_the_line_was_quiet(lost: int) -> None:
    board = without(PipedBoard(), *ONLY_ID)
    async with opening(board, **KNOWN_ONLY_ID) as connection:
        begun = now()
        board.plan(FENCE_KINDS[0], *[LOST] * lost)
        if lost == 40:
            with pytest.raises(OpenError, match="answers none of the short queries"):
                await connection.shake_hands()
        else:
            await connection.shake_hands()
            board.plan(QueryProjectIDRequest, lie(QueryProjectIDResponse(7)))
            assert (await connection.request(QueryProjectIDRequest())).project_id == 7
        assert now() > begun + 10


async def test_a_board_that_is_known_to_answer_no_short_query_is_not_opened() -> None:
    unsupported = tuple(kind.__name__.removesuffix("Request") for kind in (*FENCE_KINDS, *LIST_KINDS))
    async with opening(PipedBoard(), unsupported=unsupported) as connection:
        with pytest.raises(OpenError, match="no board answers"):
            await connection.shake_hands()


async def test_a_list_that_cannot_be_read_names_no_servos() -> None:
    board = without(PipedBoard(), *FENCE_KINDS, *LIST_KINDS[1:])
    board.usual_of[QueryServoListRequest] = Fate(damage=lambda frame: encode_frame(20011, b"\x05\x01", "little"))
    async with opening(board, unsupported=[kind.__name__.removesuffix("Request") for kind in FENCE_KINDS]) as link:
        with pytest.raises(OpenError, match="answers"):
            await link.shake_hands()


async def test_a_board_that_answers_each_query_twice_is_named_before_it_is_flooded() -> None:
    board = PipedBoard(usual=Fate(copies=2))
    async with opening(board) as connection:
        with pytest.raises(OpenError, match=r"more than once \(\d+ responses to \d+ queries .*answers_twice=yes"):
            await connection.shake_hands()
        assert len(board.sent) < 150


async def test_a_line_that_is_never_quiet_is_given_up() -> None:
    board = without(PipedBoard(), *ONLY_ID)
    async with opening(board, **KNOWN_ONLY_ID) as connection:
        for seconds in range(1, 60, 5):
            asyncio.get_running_loop().call_later(seconds, board.speak, QueryServoListResponse((1,)))
        begun = now()
        with pytest.raises(OpenError, match="answers, but too little"):
            await connection.shake_hands()
        assert begun + 40 <= now() < begun + 52


async def test_a_stop_begins_the_wait_for_quiet_again() -> None:
    board = without(PipedBoard(), *ONLY_ID)
    async with opening(board, **KNOWN_ONLY_ID) as connection:
        opened = asyncio.create_task(connection.shake_hands())
        board.plan(FENCE_KINDS[0], LOST)
        await asyncio.sleep(10.1)
        await connection.send_stop(STOP)
        await opened
        assert board.sent[-1][0] >= 20


async def test_a_connection_that_is_lost_while_it_waits_for_quiet_is_lost() -> None:
    board = without(PipedBoard(), *ONLY_ID)
    async with opening(board, **KNOWN_ONLY_ID) as connection:
        opened = asyncio.create_task(connection.shake_hands())
        await asyncio.sleep(5)
        assert not opened.done()
        begun = now()
        board.vanish()
        with pytest.raises(ConnectionLost, match="device disconnected"):
            await opened
        assert now() == begun
