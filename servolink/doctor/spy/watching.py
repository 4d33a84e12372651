"""Observers of a relay, never awaited by the relay: a thread that learns and shows, and a recording."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

from servolink.doctor.spy.learning import Learner, Passed
from servolink.recorder import (
    Direction,
)

_MOST_WAITING = 16 * 1024 * 1024  # bytes in the queue; further bytes are only counted


class Watcher:
    """Thread that passes bytes to a learner, and packets to `show`."""

    def __init__(self, learner: Learner, show: Callable[[Passed], object]) -> None:
        self._learner = learner
        self._show = show
        self._waiting: deque[tuple[float, Direction, bytes]] = deque()
        self._put = self._taken = 0  # bytes so far, each counted by one thread
        self._wake = threading.Event()
        self._is_over = False
        self._last = 0.0
        self.overlooked = 0
        """Number of bytes not observed because the queue was full."""
        self.failure: Exception | None = None
        """Reason for the end of observation: a defect of servolink, or an output that is closed."""
        self._thread = threading.Thread(target=self._run, name="spy", daemon=True)
        self._thread.start()

    def take(self, seconds: float, direction: Direction, data: bytes) -> None:
        """Take bytes that passed; never waits."""
        if self._put - self._taken > _MOST_WAITING or self.failure is not None:
            self.overlooked += len(data)
            return
        self._put += len(data)
        self._waiting.append((seconds, direction, data))
        self._wake.set()

    def end(self, patience: float) -> None:
        """Process the rest, for at most `patience` seconds."""
        self._is_over = True
        self._wake.set()
        self._thread.join(patience)

    def _run(self) -> None:
        try:
            while not self._is_over:
                self._wake.wait()
                self._wake.clear()
                self._drain()
            self._drain()
            for passed in self._learner.finish(self._last):
                self._show(passed)
        except Exception as error:  # noqa: BLE001 - the relay goes on without it, and its owner reports it
            self.failure = error

    def _drain(self) -> None:
        while self._waiting:
            seconds, direction, data = self._waiting.popleft()
            self._taken += len(data)
            self._last = seconds
            for passed in self._learner.feed(seconds, direction, data):
                self._show(passed)
