"""Turns: who may send next."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass

from servolink.connection.lanes import Lane
from servolink.errors import ConnectionLost
from servolink.escaping import escape
from servolink.transports.base import Transport


@dataclass(slots=True, eq=False)
class _Waiting:
    lane: Lane | None
    alone: bool
    granted: asyncio.Future[None]


class RequestScheduler:
    """At most `window` exchanges at a time, one per lane, in order of arrival; some alone, some first."""

    def __init__(self, window: int) -> None:
        """Allow `window` exchanges at a time (1 for a board that does not queue)."""
        self._window = window
        self._active = 0
        self._alone = False
        self._busy: set[Lane] = set()
        self._waiting: list[_Waiting] = []

    def take_at_once(self, lane: Lane | None, *, alone: bool = False) -> bool:
        """Take a turn if nobody has to be waited for."""
        free = not self._waiting and self._may(lane, alone=alone)
        if free:
            self._start(lane, alone=alone)
        return free

    async def take(self, lane: Lane | None, *, alone: bool = False, first: bool = False) -> None:
        """Wait for a turn: on `lane` (None: nothing is awaited), `alone` with no other, or `first` of all who wait."""
        if self.take_at_once(lane, alone=alone):
            return
        waiting = _Waiting(lane, alone, asyncio.get_running_loop().create_future())
        self._waiting.insert(0 if first else len(self._waiting), waiting)
        self._grant()
        try:
            await waiting.granted
        except asyncio.CancelledError:
            if waiting.granted.cancelled():
                if waiting in self._waiting:  # not when all were refused in the same moment
                    self._waiting.remove(waiting)
                self._grant()
            elif waiting.granted.exception() is None:
                self.give_back(lane)
            raise

    def take_extra(self) -> None:
        """Take a turn on no lane at once, whoever has the others; no other begins before the window has room again."""
        self._active += 1

    def give_back(self, lane: Lane | None) -> None:
        """End a turn."""
        self._active -= 1
        self._alone = self._alone and self._active > 0  # an extra turn may end before the one that is alone
        if lane is not None:
            self._busy.discard(lane)
        if self._waiting:
            self._grant()

    def borrow(self, lanes: Iterable[Lane]) -> Lane | None:
        """Use the first of `lanes` that is idle, within a turn one already has; None if all are in use."""
        idle = next((lane for lane in lanes if lane not in self._busy), None)
        if idle is not None:
            self._busy.add(idle)
        return idle

    def give_back_borrowed(self, lane: Lane) -> None:
        """End the use of a borrowed lane."""
        self._busy.discard(lane)
        self._grant()

    def refuse_all(self, error: Callable[[], Exception]) -> None:
        """Fail everyone who waits, each with an error of its own."""
        waiting, self._waiting = self._waiting, []
        for one in waiting:
            if not one.granted.done():
                one.granted.set_exception(error())

    def _may(self, lane: Lane | None, *, alone: bool) -> bool:
        if alone:
            return self._active == 0
        return not self._alone and self._active < self._window and (lane is None or lane not in self._busy)

    def _start(self, lane: Lane | None, *, alone: bool) -> None:
        self._active += 1
        self._alone = alone
        if lane is not None:
            self._busy.add(lane)

    def _grant(self) -> None:
        at = 0
        while at < len(self._waiting) and self._active < self._window:
            one = self._waiting[at]
            if one.granted.done():  # cancelled, about to leave
                at += 1
            elif self._may(one.lane, alone=one.alone):
                del self._waiting[at]
                self._start(one.lane, alone=one.alone)
                one.granted.set_result(None)
            elif one.alone:
                return  # those behind it wait with it, or it would never be alone
            else:
                at += 1


class PendingDrain:
    """Holds a turn for each frame that its sender has left behind.

    A cancelled send still goes out whole. If its turn were free at once, a program that gives up what is late would
    fill the transport's buffer, and a stop would wait behind all of that.
    """

    def __init__(self, transport: Transport, turns: RequestScheduler) -> None:
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
                "%s cannot tell when all is sent: %s", escape(self._transport.url), escape(str(error))
            )
