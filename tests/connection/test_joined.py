"""Tests of `servolink.connection.sender`: frames of callers who were woken by one chunk leave in one write."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable
from contextlib import asynccontextmanager

import pytest

from servolink.connection.connection import Connection
from servolink.errors import ConnectionLost
from servolink.protocol import (
    ExecuteActionExRequest,
    FrameParser,
    QueryServoListRequest,
    QueryServoListResponse,
    SetServoParameterRequest,
)
from tests.client.piped_board import PipedBoard, connected

DEPTH = 3
LIST, MOVE, STOP = QueryServoListRequest(), ExecuteActionExRequest(1), SetServoParameterRequest(255, 0, 1)


class Writes(PipedBoard):
    """Board that keeps each write apart, and answers only when it is told to."""

    def __init__(self) -> None:
        super().__init__()
        self.writes: list[list[int]] = []
        """Packet ids of each write."""
        self.fails = False

    def take(self, data: bytes) -> Awaitable[object] | None:
        if self.fails:
            raise ConnectionLost(f"{self.url}: the connection was lost: unplugged")
        self.writes.append([packet_id for packet_id, _ in FrameParser().feed(data)])
        return None if self.taking is None else self.taking.wait()

    def answer(self, times: int = DEPTH) -> None:
        """Answer the queries that are under way, in one chunk."""
        self.speak(*[QueryServoListResponse((1, 2))] * times)


@asynccontextmanager
async def asking(board: Writes) -> AsyncIterator[tuple[Connection, list[asyncio.Task[object]]]]:
    """Yield a connection with three tasks, each of which has sent one query and sends another when it is answered."""

    async def ask_twice() -> None:
        await connection.request(LIST)
        await connection.request(LIST)

    async with connected(board, depth=DEPTH + 1) as connection:
        tasks: list[asyncio.Task[object]] = [asyncio.create_task(ask_twice()) for _ in range(DEPTH)]
        await asyncio.sleep(0)
        assert board.writes == [[20010]] * DEPTH
        board.writes.clear()
        yield connection, tasks
        await asyncio.gather(*tasks, return_exceptions=True)


async def turns() -> None:
    """Let the woken tasks send, and the joined frames leave."""
    await asyncio.sleep(0)
    await asyncio.sleep(0)


async def test_callers_woken_together_send_in_one_write() -> None:
    board = Writes()
    async with asking(board) as (connection, tasks):
        board.answer()
        await turns()
        assert board.writes == [[20010] * DEPTH]
        board.answer()
        await asyncio.gather(*tasks)
    assert connection.stats.frames_sent == 2 * DEPTH


@pytest.mark.parametrize(("packet", "packet_id"), [(MOVE, 20060), (STOP, 20030)])
async def test_a_command_leaves_at_once_behind_the_frames_before_it(packet: object, packet_id: int) -> None:
    board = Writes()

    async def command() -> None:
        await connection.request(LIST)
        await (connection.send(MOVE) if packet is MOVE else connection.send_stop(STOP))
        assert board.writes == [[20010] * DEPTH + [packet_id]]

    async with asking(board) as (connection, tasks):
        tasks.append(asyncio.create_task(command()))
        await asyncio.sleep(0)
        board.writes.clear()
        board.answer(DEPTH + 1)
        await turns()
        await tasks.pop()
        board.answer()


async def test_a_line_that_fails_ends_all_joined_calls() -> None:
    board = Writes()
    async with asking(board) as (connection, tasks):
        board.answer()
        board.fails = True
        with pytest.raises(ConnectionLost, match="unplugged"):
            await tasks[0]
        assert connection.ended is not None
        assert all(isinstance(each, ConnectionLost) for each in await asyncio.gather(*tasks, return_exceptions=True))


async def test_a_permit_is_held_until_the_system_has_accepted_the_joined_frames() -> None:
    board = Writes()
    async with asking(board) as (connection, tasks):
        board.answer()
        board.taking = asyncio.Event()
        await turns()
        board.answer()
        await asyncio.gather(*tasks)
        more = [asyncio.create_task(connection.request(LIST)) for _ in range(DEPTH + 1)]
        await asyncio.sleep(0)
        assert board.writes == [[20010] * DEPTH, *[[20010]] * DEPTH]
        board.taking.set()
        await turns()
        await turns()
        assert board.writes == [[20010] * DEPTH, *[[20010]] * (DEPTH + 1)]
        board.answer(DEPTH + 1)
        await asyncio.gather(*more)
