"""One timer for all deadlines of a link, which a stalled event loop cannot deceive."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

_MOST_LOOKS = 100  # a board that never stops sending must not put deadlines off for ever


class Deadlines:
    """Calls `passed(now)` when the earliest deadline has passed and nothing more can be read that came before.

    After a stall the answer may already lie in the operating system's buffer. So the loop is let to read again,
    for as long as that brings bytes, before anything is declared late.
    """

    def __init__(self, passed: Callable[[float], None], received: Callable[[], int]) -> None:
        """`received` tells how many bytes have come so far."""
        self._loop = asyncio.get_running_loop()
        self._passed = passed
        self._received = received
        self._timer: asyncio.TimerHandle | None = None

    def arm(self, deadline: float) -> None:
        """Be sure to look at `deadline` (loop time); an earlier look stands."""
        if self._timer is None or deadline < self._timer.when():
            self.stop()
            self._timer = self._loop.call_at(deadline, self._reached, deadline)

    def stop(self) -> None:
        """Forget all deadlines."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _reached(self, deadline: float) -> None:
        self._timer = None
        self._look_again(deadline, -1, _MOST_LOOKS)

    def _look_again(self, deadline: float, received: int, looks: int) -> None:
        # Two turns of the loop: a turn runs its callbacks in the order found, ours before what it reads.
        self._loop.call_soon(self._loop.call_soon, self._look, deadline, received, looks)

    def _look(self, deadline: float, received: int, looks: int) -> None:
        now_received = self._received()
        if received != now_received and looks:
            self._look_again(deadline, now_received, looks - 1)
            return
        self._passed(max(deadline, self._loop.time()))  # a timer comes early by what the clock does not resolve
