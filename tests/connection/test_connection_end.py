"""The end of a connection, whoever brings it about, and cancellation while sending.

Module: servolink.connection.base_connection.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from random import Random

import pytest

from servolink.errors import ConnectionLost, RequestTimeout
from servolink.protocol import (
    AddActionRequest,
    AddActionResponse,
    ButtonEventResponse,
    ClearAllDataRequest,
    QueryActionListResponse,
    QueryActionRequest,
    QueryProjectIDRequest,
    QueryRemainPowerRequest,
    QueryServoListRequest,
    SendDummyDataRequest,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from servolink.testing import Fate
from tests.client.piped_board import LATENCY, LOST, PipedBoard, connected, late, lie, now, turns_of_the_loop
from tests.connection.unanswered import cut_content

PROJECT = QueryProjectIDRequest()


# --- the end of the connection ------------------------------------------------------------------------------------


async def test_everyone_who_waits_gets_the_first_cause() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board, depth=2) as connection:
        waiting = asyncio.gather(
            *(connection.request(packet) for packet in (PROJECT, QueryServoListRequest(), QueryRemainPowerRequest())),
            connection.send(SendDummyDataRequest(b"x")),
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
            await connection.request(PROJECT)
        with pytest.raises(ConnectionLost, match="device disconnected"):
            await connection.send(SendDummyDataRequest(b"x"))


async def test_a_board_that_vanishes_mid_frame_is_lost_at_once() -> None:
    board = PipedBoard()
    board.plan(QueryServoListRequest, Fate(damage=lambda frame: frame[:7]))
    async with connected(board) as connection:
        waiting = asyncio.create_task(connection.request(QueryServoListRequest()))
        await asyncio.sleep(0.1)
        board.vanish()
        with pytest.raises(ConnectionLost, match="device disconnected"):
            await waiting


async def test_a_board_that_vanishes_while_sending_is_lost_with_the_reason() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        ends: list[ConnectionLost] = []
        connection.answers.on_end = ends.append
        board.gone = OSError("write failed")  # and nobody says so but the send itself
        with pytest.raises(ConnectionLost, match="write failed"):
            await connection.request(PROJECT)
        with pytest.raises(ConnectionLost, match="write failed"):
            await connection.send(SendDummyDataRequest(b"x"))
        assert len(ends) == 1
        assert ends[0].__cause__ is not None
        assert connection.ended is ends[0]


async def test_a_board_that_vanishes_as_a_waiting_query_is_sent_is_lost_with_the_reason() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        first = asyncio.create_task(connection.request(PROJECT))
        second = asyncio.create_task(connection.request(QueryServoListRequest()))
        await turns_of_the_loop(2)

        def go() -> None:  # as the first response comes, and nobody says so but the send itself
            board.gone = OSError("write failed")

        asyncio.get_running_loop().call_later(LATENCY, go)
        await first
        with pytest.raises(ConnectionLost, match="write failed"):
            await second


async def test_a_board_that_vanishes_between_permit_and_sending_is_lost_with_the_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    board = PipedBoard()
    monkeypatch.setattr(board, "takes_at_once", False)  # so that the caller sends, in a later turn of the loop
    async with connected(board) as connection:

        async def ask_and_unplug() -> None:
            await connection.request(PROJECT)  # then the permit is free
            board.vanish()

        asking = asyncio.create_task(ask_and_unplug())
        await turns_of_the_loop(2)
        with pytest.raises(ConnectionLost, match="device disconnected"):
            await connection.request(QueryServoListRequest())
        await asking
        assert len(board.sent) == 1
        assert not connection.has_waiting


async def test_closing_fails_who_waits_and_may_be_repeated() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board) as connection:
        waiting = asyncio.create_task(connection.request(PROJECT))
        await asyncio.sleep(0.1)
        await connection.close()
        with pytest.raises(ConnectionLost, match="closed by this program"):
            await waiting
        await connection.close()
        with pytest.raises(ConnectionLost, match="closed by this program"):
            await connection.request(PROJECT)
    assert board.gone is not None


async def test_a_permit_that_is_granted_as_the_connection_ends_is_not_used() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        first = asyncio.create_task(connection.request(PROJECT))
        second = asyncio.create_task(connection.request(WriteProjectIDRequest(5)))
        await turns_of_the_loop(2)
        loop = asyncio.get_running_loop()
        loop.call_later(LATENCY, lambda: loop.call_soon(board.vanish))
        await asyncio.wait((first, second))
        assert isinstance(second.exception(), ConnectionLost)
        assert board.sent_of(WriteProjectIDRequest) == []


# --- a board that sends nothing any more --------------------------------------------------------------------------


@pytest.mark.parametrize("depth", [1, 4])
async def test_a_dead_board_ends_the_connection_for_all_who_wait_at_once(depth: int) -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board, depth=depth) as connection:
        begun = now()
        ends: list[float] = []

        async def ask(number: int) -> BaseException | None:
            try:
                await connection.request(QueryActionRequest(number))
            except (RequestTimeout, ConnectionLost) as error:
                ends.append(now() - begun)
                return error
            return None

        errors = await asyncio.gather(*map(ask, range(30)))
        assert len({id(error) for error in errors}) == 30
        assert isinstance(errors[0], RequestTimeout)
        assert 3 <= ends[0] < 4
        assert [type(error) for error in errors[2 * depth :]] == [ConnectionLost] * (30 - 2 * depth)
        assert ends[-1] == ends[2 * depth] < 7
        assert connection.ended is not None
        assert isinstance(connection.ended.__cause__, TimeoutError)
        with pytest.raises(ConnectionLost, match=r"the board has sent nothing for \d\.\d s"):
            await connection.request(PROJECT)


async def test_a_short_patience_takes_five_sendings_nevertheless() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board, patience=0.01) as connection:
        outcomes = []
        for number in range(8):
            with pytest.raises((RequestTimeout, ConnectionLost)) as caught:
                await connection.request(QueryActionRequest(number))
            outcomes.append(caught.type)
        assert outcomes[0] is RequestTimeout
        assert outcomes[-1] is ConnectionLost
        assert len(board.sent) == 5


async def test_silence_while_nobody_asks_is_no_silence() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        await connection.request(PROJECT)
        await asyncio.sleep(600)
        board.plan(QueryProjectIDRequest, LOST)
        await connection.request(PROJECT)
        assert connection.ended is None


@pytest.mark.parametrize("sign", ["event", "response"])
async def test_a_board_that_sends_anything_is_not_dead(sign: str) -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board) as connection:
        loop = asyncio.get_running_loop()
        packet = ButtonEventResponse(1, 1) if sign == "event" else QueryActionListResponse()
        for number in range(20):
            loop.call_later(number + 0.5, board.speak, packet)
        for number in range(5):
            with pytest.raises(RequestTimeout):
                await connection.request(QueryActionRequest(number))
        assert connection.ended is None
        board.usual = Fate()
        await connection.request(PROJECT)


async def test_bytes_that_are_no_frame_are_no_sign_of_life() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board) as connection:
        for number in range(20):
            asyncio.get_running_loop().call_later(number / 2, board.deliver, b"noise")
        with pytest.raises(RequestTimeout):
            await connection.request(PROJECT)
        with pytest.raises(ConnectionLost, match="the board has sent nothing"):
            await connection.request(QueryServoListRequest())


@pytest.mark.parametrize("seed", range(8))
async def test_a_live_line_that_loses_half_of_everything_is_never_lost(seed: int) -> None:
    chance = Random(seed)
    board = PipedBoard()
    async with connected(board, depth=chance.choice((1, 4, 8))) as connection:
        kinds = [PROJECT, QueryServoListRequest(), QueryRemainPowerRequest(), QueryActionRequest(1)]
        for kind in kinds:
            board.plan(type(kind), *(chance.choice((Fate(), LOST)) for _ in range(2000)))
        asked = (connection.request(chance.choice(kinds)) for _ in range(200))
        outcomes = await asyncio.gather(*asked, return_exceptions=True)
        assert connection.ended is None
        assert sum(isinstance(outcome, Exception) for outcome in outcomes) <= 10


async def test_while_everything_is_deleted_silence_means_nothing_for_half_a_minute() -> None:
    board = PipedBoard()
    board.plan(ClearAllDataRequest, late(29))
    async with connected(board) as connection:
        assert (await connection.request(ClearAllDataRequest())).result == 1


async def test_a_board_that_answers_nothing_of_very_much_is_given_up_though_it_sends_events() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board) as connection:
        for number in range(600):
            asyncio.get_running_loop().call_later(0.005, board.speak, ButtonEventResponse(1, 1))
            with suppress(RequestTimeout, ConnectionLost):
                await connection.request(QueryActionRequest(number), timeout=0.01)
        assert "has left 512 queries in a row unanswered" in str(connection.ended)
        assert len(board.sent) == 512


async def test_the_end_reaches_one_who_pauses_between_two_tries() -> None:
    board = PipedBoard()
    board.usual_of[QueryServoListRequest] = Fate(damage=cut_content)
    async with connected(board) as connection:
        asking = asyncio.create_task(connection.request(QueryServoListRequest()))
        await asyncio.sleep(0.03)  # after four tries
        assert len(board.sent) == 4
        begun = now()
        board.vanish()
        with pytest.raises(ConnectionLost, match="device disconnected"):
            await asking
        assert now() == begun


# --- cancellation while sending -----------------------------------------------------------------------------------


async def test_who_is_cancelled_while_sending_does_not_disturb_the_answer_of_the_next() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        board.taking = asyncio.Event()
        board.plan(WriteProjectIDRequest, lie(WriteProjectIDResponse(0)))
        cancelled = asyncio.create_task(connection.request(WriteProjectIDRequest(1)))
        await turns_of_the_loop(3)
        following = asyncio.create_task(connection.request(WriteProjectIDRequest(2)))
        cancelled.cancel()
        await turns_of_the_loop(3)
        assert cancelled.cancelled()
        assert len(board.sent) == 1
        board.taking.set()
        assert (await following).result == 1
        assert board.executed_of(WriteProjectIDRequest) == [WriteProjectIDRequest(1), WriteProjectIDRequest(2)]


async def test_a_cancelled_request_keeps_its_permit_until_it_is_answered() -> None:
    board = PipedBoard()
    board.plan(AddActionRequest, Fate(delay=0.5, says=AddActionResponse(0)))
    async with connected(board) as connection:
        cancelled = asyncio.create_task(connection.request(AddActionRequest(1, "a")))
        await asyncio.sleep(0.1)
        cancelled.cancel()
        begun = now()
        assert (await connection.request(AddActionRequest(2, "b"))).result == 1
        assert board.sent_of(AddActionRequest)[1] == pytest.approx(begun + 0.4)
        assert connection.stats.fences == 0
