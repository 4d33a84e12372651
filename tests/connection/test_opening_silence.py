"""Opening: a board that is silent, in another mode, or lost meanwhile.

Module: servolink.connection.evidence.
"""

from __future__ import annotations

import asyncio

import pytest

from servolink.connection.connection import Connection
from servolink.connection.evidence import HandshakeFailed
from servolink.errors import ConnectionLost, OpenError
from servolink.protocol import (
    AddActionRequest,
    ButtonEventResponse,
    ByteOrder,
    Codec,
    Packet,
    QueryServoListRequest,
    QueryServoListResponse,
    TransmissionModeSettingRequest,
    encode_frame,
)
from servolink.testing import Fate
from tests.client.piped_board import LOST, PipedBoard, late, now, turns_of_the_loop
from tests.connection.openings import FENCE_KINDS, LIST, kinds, opening

# --- silence, and what explains it --------------------------------------------------------------------------------


@pytest.mark.parametrize("patience", [0.5, 3.0, 10.0])
async def test_a_silent_board_is_given_up_after_the_patience_and_five_tries(patience: float) -> None:
    board = PipedBoard(usual=LOST)
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


async def test_the_byte_order_to_try_is_the_other_one() -> None:
    board = PipedBoard(usual=LOST, byte_order="big")
    async with opening(board) as connection:
        with pytest.raises(OpenError, match=r"no board answers .*the other byte order \(byte_order=little\)"):
            await connection.shake_hands()


@pytest.mark.parametrize(("used", "other"), [("little", "big"), ("big", "little")])
async def test_bytes_without_a_frame_are_explained_by_order_and_baud_rate(used: ByteOrder, other: ByteOrder) -> None:
    board = PipedBoard(usual=Fate(damage=lambda frame: bytes(37 * byte % 251 for byte in frame)), byte_order=used)
    async with opening(board) as connection:
        begun = now()
        with pytest.raises(OpenError, match=rf"sends bytes, .*but no frame .*byte_order={other}.* baud rate.*doctor"):
            await connection.shake_hands()
        assert begun + 3 < now() <= begun + 5.2  # the board may still be starting


@pytest.mark.parametrize(("spoken_at", "given_up_at"), [((1,), 7), ((1, 2.5, 5, 9), 15)])
async def test_a_board_that_answers_too_little_has_more_time_and_is_told_from_a_silent_one(
    spoken_at: tuple[float, ...], given_up_at: float
) -> None:
    """Twice the patience after its latest response, and four times that in all."""
    board = PipedBoard(usual=LOST)
    async with opening(board) as connection:
        begun = now()
        for seconds in spoken_at:
            asyncio.get_running_loop().call_later(seconds, board.speak, QueryServoListResponse((1,)))
        with pytest.raises(OpenError, match=r"answers, but too little .*the line is bad, or the board is busy"):
            await connection.shake_hands()
        assert now() == pytest.approx(begun + given_up_at)


async def test_a_board_that_only_sends_button_events_is_not_a_silent_one() -> None:
    board = PipedBoard(usual=LOST)
    async with opening(board) as connection:
        asyncio.get_running_loop().call_later(0.1, board.speak, ButtonEventResponse(1, 1))
        with pytest.raises(OpenError, match="sends button events, but answers none of the short queries"):
            await connection.shake_hands()
        assert board.sent_of(TransmissionModeSettingRequest) == []


async def test_whoever_waits_for_it_and_whoever_comes_later_is_told_why_it_failed() -> None:
    board = PipedBoard(usual=LOST)
    async with opening(board) as connection:
        errors = await asyncio.gather(
            connection.request(LIST),
            connection.shake_hands(),
            connection.request(AddActionRequest(1)),
            return_exceptions=True,
        )
        assert [type(error) for error in errors] == [ConnectionLost, HandshakeFailed, ConnectionLost]
        assert "no board answers" in str(errors[0])
        assert str(errors[0]).count("fake://board") == 1
        with pytest.raises(ConnectionLost, match="no board answers"):
            await connection.request(LIST)
        with pytest.raises(ConnectionLost, match="no board answers"):
            await connection.shake_hands()
        assert AddActionRequest not in kinds(board)


# --- transmission mode --------------------------------------------------------------------------------------------


async def test_a_board_in_the_other_mode_is_woken_once() -> None:
    class Asleep(PipedBoard):
        """It answers nothing until mode 1 is set."""

        def _take(self, packet: Packet, frame: bytes) -> None:
            if isinstance(packet, TransmissionModeSettingRequest):
                self.usual = Fate()
            super()._take(packet, frame)

    board = Asleep(usual=LOST)
    async with opening(board) as connection:
        await connection.shake_hands()
        assert board.executed_of(TransmissionModeSettingRequest) == [TransmissionModeSettingRequest(1)]
        assert kinds(board).index(TransmissionModeSettingRequest) == 2
        await connection.request(LIST)
        assert connection.stats.unsolicited == 0


async def test_a_board_that_answers_keeps_its_mode() -> None:
    board = PipedBoard()
    for kind in FENCE_KINDS:
        board.plan(kind, Fate(), LOST, LOST, LOST)
    async with opening(board) as connection:
        await connection.shake_hands()
        assert TransmissionModeSettingRequest not in kinds(board)


async def test_the_mode_is_not_touched_if_nobody_wants_that() -> None:
    board = PipedBoard(usual=LOST)
    async with opening(board, transmission_mode="keep") as connection:
        with pytest.raises(OpenError):
            await connection.shake_hands()
        assert TransmissionModeSettingRequest not in kinds(board)


# --- lost meanwhile -----------------------------------------------------------------------------------------------


async def test_a_connection_that_is_lost_meanwhile_is_lost_for_all_who_wait_at_once() -> None:
    board = PipedBoard(usual=late(0.1))
    async with opening(board) as connection:
        waiting = asyncio.gather(connection.shake_hands(), connection.request(LIST), return_exceptions=True)
        await asyncio.sleep(0.25)
        begun = now()
        board.vanish()
        errors = await waiting
        assert now() == begun
        assert [type(error) for error in errors] == [ConnectionLost, ConnectionLost]
        assert all("device disconnected" in str(error) for error in errors)


async def test_a_board_that_vanishes_while_it_is_asked_is_lost_with_the_reason() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        board.gone = OSError("write failed")
        with pytest.raises(ConnectionLost, match="write failed"):
            await connection.shake_hands()


async def test_closing_ends_it() -> None:
    board = PipedBoard(usual=LOST)
    async with opening(board) as connection:
        opened = asyncio.create_task(connection.shake_hands())
        await asyncio.sleep(0.1)
        await connection.close()
        with pytest.raises(ConnectionLost, match="closed by this program"):
            await opened


def test_a_program_that_ends_meanwhile_is_quiet(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        board = PipedBoard(usual=LOST)
        connection = Connection(board)
        await connection.open()
        asyncio.create_task(connection.shake_hands())  # noqa: RUF006 - it is to be left behind
        await turns_of_the_loop(3)

    asyncio.run(main())
    assert caplog.messages == []


# --- what came instead of a response ------------------------------------------------------------------------------


def longer(frame: bytes) -> bytes:
    """Return `frame` with one more byte of content than the document says."""
    packet_id = int.from_bytes(frame[4:6], "little")
    return encode_frame(packet_id, frame[8:-1] + b"\x01", "little")


async def test_contents_that_are_longer_than_in_the_document_are_named_and_can_be_ignored() -> None:
    board = PipedBoard(usual=Fate(damage=longer))
    async with opening(board) as connection:
        with pytest.raises(OpenError, match=r"more content than the document says, .*use ignore_extra=yes"):
            await connection.shake_hands()
    board.gone = None
    async with opening(board, ignore_extra=True) as connection:
        assert (await connection.request(LIST)).servo_id_list == (1, 2, 3, 4)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (Codec("big").encode(QueryServoListResponse((1,))), "answers in big byte order .*use byte_order=big"),
        (Codec().encode(QueryServoListRequest()), "returns the requests that are sent to it"),
        (b"ets Jun  8 2016 00:22:57\r\nrst:0x1\r\n", r"sends text, 'ets Jun  8 2016 00:22:57 / rst:0x1"),
    ],
)
async def test_what_came_is_named(answer: bytes, words: str) -> None:
    board = PipedBoard(usual=Fate(damage=lambda frame: answer))
    async with opening(board) as connection:
        with pytest.raises(HandshakeFailed, match=words) as caught:
            await connection.shake_hands()
    assert caught.value.evidence.is_board == answer.startswith(b"\x13\x4c\x05\x1d\x4e\x2b")
