"""Link: the end of the connection, and cancellation while sending."""

from __future__ import annotations

import asyncio

import pytest

from servolink.errors import ConnectionLost
from servolink.protocol.editing import (
    AddActionRequest,
    AddActionResponse,
    QueryProjectIDRequest,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from servolink.protocol.servos import QueryServoListRequest
from servolink.protocol.settings import QueryRemainPowerRequest, SendDummyDataRequest
from tests.client.fake_board import LATENCY, LOST, FakeBoard, Fate, lie, linked, now, turns_of_the_loop
from tests.virtual_time import run

PROJECT = QueryProjectIDRequest()


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
            board.taking.set()
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
