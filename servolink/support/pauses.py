"""Growing pauses between attempts, and connections reopened after each loss."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Generic, TypeVar

T = TypeVar("T")

FIRST_PAUSE = 0.1
LONGEST_PAUSE = 5.0


class Pauses:
    """Pauses in seconds, each twice as long as the previous pause, up to `longest`."""

    def __init__(
        self, first: float = FIRST_PAUSE, longest: float = LONGEST_PAUSE, jitter: Callable[[], float] = lambda: 1.0
    ) -> None:
        """Start with the pause `first`. Each pause is multiplied by the result of `jitter`."""
        self.next = first
        """Seconds of the next pause, without jitter."""
        self._first = first
        self._longest = longest
        self._jitter = jitter

    async def wait(self) -> None:
        """Wait for the next pause."""
        pause, self.next = self.next, min(2 * self.next, self._longest)
        await asyncio.sleep(pause * self._jitter())

    def restart(self) -> None:
        """Begin with the first pause again: the last attempt has succeeded."""
        self.next = self._first


class Reconnecting(AsyncIterator[T], Generic[T]):
    """Asynchronous iterator over connections: the first immediately, each later connection after a pause.

    A failed attempt is repeated after a pause if `retry`, called with the error, returns True; otherwise the error is
    raised. Call `pauses.restart` when a connection has proved to work.
    """

    def __init__(self, open_: Callable[[], Awaitable[T]], pauses: Pauses, retry: Callable[[Exception], bool]) -> None:
        """Open each connection with `open_`, which must leave nothing open after an error."""
        self._open = open_
        self._pauses = pauses
        self._retry = retry
        self._is_first = True

    async def __anext__(self) -> T:
        """Return the next connection."""
        while True:
            if not self._is_first:
                await self._pauses.wait()
            self._is_first = False
            try:
                return await self._open()
            except Exception as error:
                if not self._retry(error):
                    raise
