"""ResponseDispatcher: what becomes of the bytes that come."""

from __future__ import annotations

import asyncio

from servolink.errors import ConnectionLost
from servolink.protocol import (
    ButtonEventResponse,
    QueryServoListRequest,
    QueryServoResponse,
)
from tests.client.piped_board import PipedBoard, connected, turns_of_the_loop


async def test_events_go_to_whoever_wants_them_and_noise_is_counted() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        events: list[ButtonEventResponse] = []
        board.speak(ButtonEventResponse(1, 1))
        connection.answers.on_event = events.append
        board.speak(ButtonEventResponse(2, 4))
        board.deliver(b"noise" + bytes(3))
        assert events == [ButtonEventResponse(2, 4)]
        assert connection.stats.events_received == 2
        assert connection.stats.skipped["noise"] == 8


async def test_what_comes_after_the_end_changes_nothing() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        ends: list[ConnectionLost] = []
        connection.answers.on_end = ends.append
        waiting = asyncio.create_task(connection.request(QueryServoListRequest()))
        await turns_of_the_loop(3)
        board.vanish()
        board.speak(QueryServoResponse())
        connection.answers.lost(OSError("again"))
        await asyncio.wait((waiting,))
        assert "device disconnected" in str(waiting.exception())
        assert connection.ended is ends[0]
        assert "device disconnected" in str(ends[0])
        assert len(ends) == 1


async def test_it_and_its_neighbours_have_few_enough_attributes_to_be_fast() -> None:
    async with connected(PipedBoard()) as connection:
        await connection.request(QueryServoListRequest())
        # CPython takes 1.4 times as long to find one of more than 29.
        assert max(len(vars(each)) for each in (connection, connection.answers, connection.answers.watchdog)) <= 29
