"""Notices that the system takes no more bytes, with one timer however many sends wait."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from servolink.transports.base import STALL_LIMIT

_STALL_STEP = STALL_LIMIT / 8


class StallWatch:
    """Looks now and then while `waiting()`, and calls `stalled` when `taken()` has not grown for STALL_LIMIT."""

    def __init__(
        self, waiting: Callable[[], bool], taken: Callable[[], int], stalled: Callable[[TimeoutError], None]
    ) -> None:
        """Watch the number `taken()`, which grows with what the system takes."""
        self._waiting = waiting
        self._taken = taken
        self._stalled = stalled
        self._timer: asyncio.TimerHandle | None = None

    @property
    def running(self) -> bool:
        """Whether it has a timer."""
        return self._timer is not None

    def start(self) -> None:
        """Begin, if it has not yet; it ends by itself when nobody waits any more."""
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(_STALL_STEP, self._look, self._taken(), 1)

    def stop(self) -> None:
        """End at once."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look(self, taken: int, looks: int) -> None:
        """Look for the `looks`-th time whether more than `taken` has been taken."""
        self._timer = None
        if not self._waiting():
            return  # the next send that has to wait starts it again
        if self._taken() != taken:
            taken, looks = self._taken(), 0
        elif looks * _STALL_STEP >= STALL_LIMIT:  # time alone also passes while all of us stand still
            self._stalled(TimeoutError(f"it has taken no byte for {STALL_LIMIT:g} s"))
            return
        self._timer = asyncio.get_running_loop().call_later(_STALL_STEP, self._look, taken, looks + 1)
