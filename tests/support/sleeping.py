"""A computer that sleeps: the clock of event loops stands still meanwhile, on every system."""

from __future__ import annotations

import sys
import time
from types import SimpleNamespace

import pytest

from servolink.support.platforms import timers

HOUR = 3600.0


class Computer:
    """The clocks of the system, as far as time asleep differs between them."""

    CLOCK_MONOTONIC, CLOCK_BOOTTIME, CLOCK_UPTIME_RAW = range(3)

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._asleep = 12.0  # since it was switched on
        self._now = 5000.0
        self.pauses: list[float] = []
        """Seconds that this program is not run after each of the next readings."""
        monkeypatch.setattr(timers, "time", self)
        if sys.platform in {"win32", "emscripten"}:
            monkeypatch.setattr(timers, "sys", SimpleNamespace(platform="linux"))

    def sleep(self, seconds: float = HOUR) -> None:
        """Sleep: no program runs, and only some clocks go on."""
        self._asleep += seconds

    def clock_gettime(self, which: int) -> float:
        counting = self.CLOCK_MONOTONIC if sys.platform == "darwin" else self.CLOCK_BOOTTIME
        reading = self._now + (self._asleep if which == counting else 0.0)
        self._now += self.pauses.pop(0) if self.pauses else 0.0
        return reading


def set_wall_clock(monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    """Set the clock of this computer forth, or back, as a person or a time server does."""
    wall, wall_ns = time.time, time.time_ns
    monkeypatch.setattr(time, "time", lambda: wall() + seconds)
    monkeypatch.setattr(time, "time_ns", lambda: wall_ns() + round(seconds * 1e9))


@pytest.fixture
def computer(monkeypatch: pytest.MonkeyPatch) -> Computer:
    """A computer whose sleep the test decides."""
    return Computer(monkeypatch)
