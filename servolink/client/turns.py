"""Turns: who may send next."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from servolink.client.lanes import Lane


@dataclass(slots=True, eq=False)
class _Waiting:
    lane: Lane | None
    alone: bool
    granted: asyncio.Future[None]


class Turns:
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
