"""A board belongs to the event loop in which it was connected."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from servolink.client import Board, connect
from servolink.protocol import ExecuteActionRequest, Step
from servolink.virtual import VirtualBoard, VirtualTransport

CALLS: dict[str, Callable[[Board], Awaitable[object]]] = {
    "request": lambda board: board.battery(),
    "send": lambda board: board.send(ExecuteActionRequest((Step(1, 5, 10),))),
    "stop": lambda board: board.stop(),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_in_another_loop_it_says_so_at_once(call: Callable[[Board], Awaitable[object]]) -> None:
    async def connected() -> Board:
        return await connect(VirtualTransport(VirtualBoard()))

    async def used(board: Board) -> None:
        await call(board)

    async def beside(board: Board) -> None:
        with pytest.raises(RuntimeError, match="was connected in another event loop: use it there, or connect"):
            await asyncio.to_thread(asyncio.run, used(board))
        assert await board.battery()
        await board.close()

    with asyncio.Runner() as runner:
        runner.run(beside(runner.run(connected())))
    with pytest.raises(
        RuntimeError, match="was connected in another event loop, which has ended: connect again in this one"
    ):
        asyncio.run(used(asyncio.run(connected())))
