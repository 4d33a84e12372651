"""Permits: which request may be sent next, and how many may be under way."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from msgspec import Struct

from servolink.connection.slots import Obstacle, Slots
from servolink.errors import ConnectionLost
from servolink.escaping import escape
from servolink.protocol.packet import Command, Request
from servolink.transports.base import Transport


class _Waiting(Struct, eq=False):
    packet: Request[Any] | Command
    granted: asyncio.Future[None]


class RequestScheduler:
    """Grants at most `depth` permits at a time, strictly in order of arrival; a stop's read-back comes first.

    Only the first in the queue is ever looked at, so the cost does not grow with their number.
    """

    def __init__(self, depth: int, slots: Slots) -> None:
        """Allow `depth` requests under way (1 for a board that does not queue) beside the open `slots`."""
        self._depth = depth
        self._slots = slots
        self._permits = 0
        self._paused = False
        self.waiting: deque[_Waiting] = deque()
        """Those who wait for a permit."""
        self._granted: list[Request[Any] | Command] = []  # have a permit and are not in `slots` yet

    def acquire_at_once(self, packet: Request[Any] | Command) -> bool:
        """Take a permit if nothing stands in the way of `packet`, which must be sent at once. `release` must follow."""
        if (
            self.waiting
            or self._paused
            or self._permits >= self._depth
            or self._granted
            or self._slots.obstacle(packet) is not Obstacle.NONE
        ):
            return False
        self._permits += 1
        return True

    async def acquire(self, packet: Request[Any] | Command, *, first: bool = False) -> None:
        """Wait for a permit, `first` before all who wait. `sent` must follow, then `release`."""
        waiting = _Waiting(packet, asyncio.get_running_loop().create_future())
        if first:
            self.waiting.appendleft(waiting)
        else:
            self.waiting.append(waiting)
        self.grant()
        try:
            await waiting.granted
        except asyncio.CancelledError:
            if not waiting.granted.cancelled() and waiting.granted.exception() is None:
                self.sent(packet)
                self.release()
            elif self.waiting and self.waiting[0] is waiting:
                self.grant()  # it held back those behind it
            raise

    def sent(self, packet: Request[Any] | Command) -> None:
        """The packet has its slot, or will not be sent: those behind it may follow."""
        self._granted.remove(packet)  # or an equal one, which is as good
        if self.waiting:
            self.grant()

    def release(self) -> None:
        """Give a permit back."""
        self._permits -= 1
        if self.waiting:
            self.grant()

    def take_extra(self) -> None:
        """Take a permit at once, whoever has the others; nobody gets another one before there is room again."""
        self._permits += 1

    def pause(self) -> None:
        """Grant nothing until `resume`: the connection is being opened."""
        self._paused = True

    def resume(self) -> None:
        """Grant permits again."""
        self._paused = False
        self.grant()

    def refuse_all(self, error: Callable[[], Exception]) -> None:
        """Fail all who wait, each with an error of its own."""
        waiting, self.waiting = self.waiting, deque()
        for each in waiting:
            if not each.granted.done():
                each.granted.set_exception(error())

    def grant(self) -> None:
        """Grant permits to those at the head of the queue that may be sent now."""
        while self.waiting:
            head = self.waiting[0]
            if not head.granted.done():
                if not self._may(head.packet):
                    return
                self._take(head.packet)
                head.granted.set_result(None)
            self.waiting.popleft()  # granted, or cancelled before

    def _may(self, packet: Request[Any] | Command) -> bool:
        return (
            not self._paused
            # The board is done with a request whose response is kept.
            and self._permits < self._depth + self._slots.kept
            and self._slots.obstacle(packet, self._granted) is not Obstacle.WAIT
        )

    def _take(self, packet: Request[Any] | Command) -> None:
        self._permits += 1
        self._granted.append(packet)


class PendingDrain:
    """Holds a permit for each frame that its sender has left behind.

    A cancelled send still goes out whole. If its permit were free at once, a program that gives up late requests would
    fill the transport's buffer, and a stop would wait behind all of that.
    """

    def __init__(self, transport: Transport, scheduler: RequestScheduler) -> None:
        """Hold permits of `scheduler` until `transport` has sent what was left behind."""
        self._transport = transport
        self._scheduler = scheduler
        self._tasks: set[asyncio.Task[None]] = set()  # kept, as the loop does not keep its tasks

    def hold(self) -> None:
        """Hold one permit more than the depth allows until all that was sent so far has left."""
        self._scheduler.take_extra()
        task = asyncio.get_running_loop().create_task(self._left())
        # The program may well end first, and nobody needs a warning about that; asyncio.gather does the same.
        task._log_destroy_pending = False  # type: ignore[attr-defined]  # noqa: SLF001
        self._tasks.add(task)
        task.add_done_callback(self._give_back)

    def end(self) -> None:
        """Hold no permit any more: the connection is closed."""
        for task in self._tasks:
            task.cancel()

    async def _left(self) -> None:
        with suppress(ConnectionLost):  # the transport tells its receiver itself
            await self._transport.send(b"")

    def _give_back(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        self._scheduler.release()
        if not task.cancelled() and (error := task.exception()) is not None:
            logging.getLogger(__name__).error(
                "%s cannot tell when all is sent: %s", escape(self._transport.url), escape(str(error))
            )
