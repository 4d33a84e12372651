"""HandOver: bounded queue of calls from the network thread of paho-mqtt to the event loop.

A full queue blocks the thread. The thread then reads nothing more, so that TCP holds the broker back, and the memory
stays bounded however much somebody sends. A stop has room of its own, and is handled before all that waits. In the
same turn of the event loop all that was received before the stop is handled: it must meet the barrier that a stop
raises, which the broker can lower as soon as the event loop turns again.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from threading import Condition
from typing import NamedTuple

_AT_ONCE = 64  # calls before other work of the event loop has a turn


class _HandedOver(NamedTuple):
    work: Callable[[], None]
    size: int


class HandOver:
    """Bounded queue of calls, filled by one thread and emptied by the event loop."""

    def __init__(self, room: int) -> None:
        """Hold calls of up to `room` bytes, and as much again of stops. Create in the event loop."""
        self._loop = asyncio.get_running_loop()
        self._room = room
        self._calls: deque[_HandedOver] = deque()
        self._stops: deque[_HandedOver] = deque()
        self._used = 0  # bytes
        self._is_due = False
        self._is_closed = False
        self._changed = Condition()

    def put(self, work: Callable[[], None], size: int = 0, *, is_stop: bool = False) -> None:
        """Have the event loop call `work`, which must not raise. To be called by the thread.

        Block while there is no room for `size` bytes. A call without a size never blocks: paho-mqtt holds a lock then,
        for which the event loop could be waiting. A stop is called before all others.
        """
        room = 2 * self._room if is_stop else self._room
        with self._changed:
            while size and self._used >= room and not self._is_closed:
                self._changed.wait()
            if size and self._is_closed:
                return
            (self._stops if is_stop else self._calls).append(_HandedOver(work, size))
            self._used += size
            if self._is_due:  # one call for a whole burst
                return
            self._is_due = True
        with suppress(RuntimeError):  # the event loop has been closed
            self._loop.call_soon_threadsafe(self._take)

    def close(self) -> None:
        """Drop what waits, except calls without a size, and never block again."""
        with self._changed:
            self._is_closed = True
            self._stops.clear()
            self._calls = deque(call for call in self._calls if not call.size)
            self._used = 0
            self._changed.notify_all()

    def _take(self) -> None:
        with self._changed:
            calls = [*self._stops]
            count = len(self._calls) if self._stops else min(_AT_ONCE, len(self._calls))
            calls += [self._calls.popleft() for _ in range(count)]
            self._stops.clear()
            self._used -= sum(call.size for call in calls)
            if 2 * self._used <= self._room:  # not for each call, as each change of threads takes time
                self._changed.notify_all()
            self._is_due = bool(self._calls)
        if self._is_due:
            self._loop.call_soon(self._take)
        for call in calls:
            call.work()
