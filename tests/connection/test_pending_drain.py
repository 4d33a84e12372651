"""PendingDrain: what a cancelled sender left behind keeps its permit until the system has taken it.

Module: servolink.connection.frame_writer.
"""

from __future__ import annotations

import asyncio
import gc
from collections.abc import Awaitable, Callable
from contextlib import suppress

import pytest

from servolink.connection.connection import Connection
from servolink.errors import ConnectionLost
from servolink.protocol import (
    ClearAllDataRequest,
    ExecuteActionRequest,
    QueryMemorySizeRequest,
    SendDummyDataRequest,
    SetServoParameterRequest,
    Step,
    WriteProjectIDRequest,
)
from tests.client.piped_board import PipedBoard, connected, turns_of_the_loop
from tests.virtual_time import run

STOP = SetServoParameterRequest(255, 0, 1)
SENDS: dict[str, Callable[[Connection], Awaitable[object]]] = {
    "move": lambda connection: connection.send(ExecuteActionRequest((Step(1, 5, 10),))),
    "query": lambda connection: connection.request(QueryMemorySizeRequest()),
    "change": lambda connection: connection.request(WriteProjectIDRequest(5)),
    "clear": lambda connection: connection.request(ClearAllDataRequest()),
}


async def give_up(call: Awaitable[object], seconds: float) -> None:
    with suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            await call


@pytest.mark.parametrize("name", SENDS)
@pytest.mark.parametrize("depth", [1, 3])
async def test_what_is_given_up_again_and_again_does_not_pile_up_before_a_stop(name: str, depth: int) -> None:
    board = PipedBoard()
    async with connected(board, depth=depth) as connection:
        board.taking = asyncio.Event()
        for _ in range(100):
            await give_up(SENDS[name](connection), 0.01)
        assert len(board.sent) <= depth
        stopping = asyncio.create_task(connection.send_stop(STOP))
        await turns_of_the_loop(1)
        assert board.sent[-1][1] == STOP
        board.taking.set()
        await stopping
        await turns_of_the_loop(3)
        await asyncio.sleep(0.05)
        assert connection.scheduler._permits == 0
        assert (await connection.request(QueryMemorySizeRequest())).size


async def test_a_packet_aside_leaves_behind_what_was_written_and_keeps_a_permit_until_it_is_taken() -> None:
    board, aside = PipedBoard(), SendDummyDataRequest(b"aside")
    async with connected(board, depth=3) as connection:
        connection.send_aside(aside)
        await turns_of_the_loop(3)
        assert connection.scheduler._permits == 0
        board.taking = asyncio.Event()
        moving = asyncio.create_task(connection.send(ExecuteActionRequest((Step(1, 5, 10),))))
        await turns_of_the_loop(2)
        connection.send_aside(aside)
        await turns_of_the_loop(2)
        assert [type(packet) for _, packet in board.sent[-2:]] == [ExecuteActionRequest, SendDummyDataRequest]
        assert connection.scheduler._permits == 2
        board.taking.set()
        await moving
        await turns_of_the_loop(3)
        assert connection.scheduler._permits == 0
        await connection.close()
        with pytest.raises(ConnectionLost, match="closed by this program"):
            connection.send_aside(aside)


@pytest.mark.parametrize("name", SENDS)
async def test_the_end_of_the_link_ends_the_wait_for_what_was_left_behind(name: str) -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        board.taking = asyncio.Event()
        await give_up(SENDS[name](connection), 0.01)
        waiting = asyncio.create_task(connection.send(ExecuteActionRequest((Step(1, 6, 10),))))
        await turns_of_the_loop(2)
        await connection.close()
        with pytest.raises(ConnectionLost, match="closed by this program"):
            await waiting
        assert len(board.sent) == 1


async def test_a_line_that_is_lost_meanwhile_tells_so_itself() -> None:
    class Stalled(PipedBoard):
        async def send(self, data: bytes) -> None:
            await super().send(data)
            if self.gone is not None:
                raise ConnectionLost(str(self.gone))

    board = Stalled()
    connection = Connection(board)
    await connection.open()
    board.taking = asyncio.Event()
    await give_up(SENDS["move"](connection), 0.01)
    board.vanish()
    board.taking.set()
    await turns_of_the_loop(3)
    assert connection.scheduler._permits == 0
    with pytest.raises(ConnectionLost, match="device disconnected"):
        await connection.send(ExecuteActionRequest((Step(1, 6, 10),)))
    await connection.close()


def test_a_transport_that_cannot_tell_gives_its_permit_back_and_is_named(caplog: pytest.LogCaptureFixture) -> None:
    class Strict(PipedBoard):
        async def send(self, data: bytes) -> None:
            if not data:
                raise ValueError("nothing to send\x1b")
            await super().send(data)

    async def main() -> None:
        board = Strict()
        async with connected(board) as connection:
            board.taking = asyncio.Event()
            await give_up(SENDS["move"](connection), 0.01)
            await turns_of_the_loop(3)
            assert connection.scheduler._permits == 0

    run(main())
    assert caplog.messages == ["fake://board cannot tell when all is sent: nothing to send\\x1b"]


def test_the_end_of_a_program_with_something_left_behind_is_quiet(caplog: pytest.LogCaptureFixture) -> None:
    kept = []  # or the connection ends before the loop does

    async def main() -> None:
        board = PipedBoard()
        connection = Connection(board)
        await connection.open()
        board.taking = asyncio.Event()
        kept.append((connection, asyncio.create_task(connection.send(ExecuteActionRequest((Step(1, 6, 10),))))))
        await turns_of_the_loop(2)

    asyncio.run(main())
    assert len(kept[0][0]._writer._drain._drains) == 1
    kept.clear()
    gc.collect()
    assert caplog.messages == []
