"""Timers of event loops, and the clock of deadlines, which counts the time in which the computer sleeps."""

from __future__ import annotations

import asyncio
import math
import sys
import time
from collections.abc import Callable
from typing import Any

_SHORTEST = 1.0  # seconds that count as a sleep
_READINGS = 5  # at most, for two clocks that are read one after the other, maybe with a pause between
_CLOSE = 1e-4  # seconds from one reading to the next without a pause


def seconds_asleep() -> float:
    """Return the seconds that the computer has slept so far; 0 on Windows, where the clock of event loops goes on."""
    if sys.platform == "linux":
        return _ahead(time.clock_gettime, time.CLOCK_BOOTTIME, time.CLOCK_MONOTONIC)
    elif sys.platform == "darwin":
        return _ahead(time.clock_gettime, time.CLOCK_MONOTONIC, time.CLOCK_UPTIME_RAW)
    else:
        return 0.0


def _ahead(read: Callable[[int], float], clock: int, other: int) -> float:
    """Return the seconds by which a clock is ahead of another, without pauses of this program between readings."""
    best = (math.inf, 0.0)
    for _ in range(_READINGS):
        before = read(other)
        reading = read(clock)
        pause = read(other) - before
        best = min(best, (pause, reading - before))
        if pause < _CLOSE:
            break
    return best[1]


def time_with_sleep() -> float:
    """Return the time of the running event loop, plus the seconds asleep: deadlines of motions are on this clock."""
    return asyncio.get_running_loop().time() + seconds_asleep()


class SleepCounter:
    """Counter of the times that the computer has slept for more than a second."""

    def __init__(self) -> None:
        """Start at 0."""
        self._count = 0
        self._asleep = seconds_asleep()

    def __call__(self) -> int:
        """Return the number of times so far."""
        asleep = seconds_asleep()
        if asleep - self._asleep > _SHORTEST:
            self._count += 1
            self._asleep = asleep
        return self._count


def call_at(
    loop: asyncio.AbstractEventLoop, when: float, callback: Callable[..., object], *args: Any
) -> asyncio.TimerHandle:
    """Call `callback(*args)` when the time of `loop` is `when`; as soon as possible if that time has passed.

    The event loop of Pyodide raises ValueError for a time that has passed, even if only while the call was made.
    """
    if sys.platform == "emscripten":
        return loop.call_later(max(0.0, when - loop.time()), callback, *args)
    else:
        return loop.call_at(when, callback, *args)
