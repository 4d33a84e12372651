"""Turns for bytes whose sender was cancelled while they waited for the system to take them."""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress

from servolink.client.turns import Turns
from servolink.errors import ConnectionLost
from servolink.printable import printable
from servolink.transports.base import Transport


class Leaving:
    """Holds a turn for each frame that its sender has left behind.

    A cancelled send still goes out whole. If its turn were free at once, a program that gives up what is late would
    fill the transport's buffer, and a stop would wait behind all of that.
    """

    def __init__(self, transport: Transport, turns: Turns) -> None:
        """Hold turns of `turns` until `transport` has sent what was left behind."""
        self._transport = transport
        self._turns = turns
        self._tasks: set[asyncio.Task[None]] = set()  # kept, as the loop does not keep its tasks

    def hold(self) -> None:
        """Hold one turn more than the window allows until all that was sent so far has left."""
        self._turns.take_extra()
        task = asyncio.get_running_loop().create_task(self._left())
        # The end of a program may well come first, which nobody needs to be told; asyncio.gather does the same.
        task._log_destroy_pending = False  # type: ignore[attr-defined]  # noqa: SLF001
        self._tasks.add(task)
        task.add_done_callback(self._give_back)

    def end(self) -> None:
        """Hold no turn any more: the link is closed."""
        for task in self._tasks:
            task.cancel()

    async def _left(self) -> None:
        with suppress(ConnectionLost):  # the transport tells its receiver itself
            await self._transport.send(b"")

    def _give_back(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        self._turns.give_back(None)
        if not task.cancelled() and (error := task.exception()) is not None:
            logging.getLogger(__name__).error(
                "%s cannot tell when all is sent: %s", printable(self._transport.url), printable(str(error))
            )
