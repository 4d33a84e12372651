"""servolink without async: the same boards, for scripts, notebooks and beginners.

with servolink.sync.connect("virtual://") as board:
    board.move({1: 60, 2: 30}, duration=0.5, wait=True)
    print(board.servo(1).angle)

All boards share one event loop, in a background thread started with the first board.
"""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from inspect import signature
from typing import Any, ParamSpec

from servolink import client
from servolink.boards import search
from servolink.sync.board import Board, ServoStream
from servolink.sync.iterator import BlockingIterator, ButtonEvents, ServoReadings
from servolink.sync.loop_thread import LoopThread, running_thread
from servolink.sync.recording import Recorder, record
from servolink.transports import DeviceInfo

__all__ = [
    "BlockingIterator",
    "Board",
    "ButtonEvents",
    "Recorder",
    "ServoReadings",
    "ServoStream",
    "connect",
    "discover",
    "reconnecting",
    "record",
]

P = ParamSpec("P")


def _connecting(make: Callable[P, client.connect]) -> Callable[P, Board]:
    """Return a blocking function with the arguments of `servolink.connect`."""

    def connect(*args: P.args, **kwargs: P.kwargs) -> Board:
        """Connect to a board, closed at the end of a `with` block or by `close`.

        Takes the address and options of `servolink.connect`, and raises the same errors. A board still open at the end
        of the program is closed.
        """
        connecting, thread = make(*args, **kwargs), running_thread()
        return thread.run(_open, thread, connecting)

    vars(connect)["__signature__"] = signature(make).replace(return_annotation=Board)  # the signature in `help`
    return connect


connect = _connecting(client.connect)


async def _open(thread: LoopThread, connecting: client.connect) -> Board:
    return Board(thread, await connecting.open())


def reconnecting(url: str | None = None, **options: Any) -> BlockingIterator[Board]:
    """Yield a connected board, and after each loss a newly connected board.

    After ConnectionLost, `continue` the `for` loop; leaving the loop closes the last board. Takes the address and
    options of `servolink.connect`.
    """
    thread = running_thread()
    return BlockingIterator(thread, _boards(thread, client.reconnecting(url, **options)))


async def _boards(thread: LoopThread, boards: AsyncGenerator[client.Board, None]) -> AsyncGenerator[Board, None]:
    async with aclosing(boards):
        async for board in boards:
            yield Board(thread, board)


def discover() -> list[DeviceInfo]:
    """Return possible boards: devices, and the virtual and shared boards on the local machine.

    No port is opened; see `servolink.discover`.
    """
    return search()
