"""Tasks: those that run in the background, and end with whoever began them."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


class Tasks:
    """Tasks that nobody waits for; they are kept here, as the event loop does not keep its tasks."""

    def __init__(self) -> None:
        """Start without any, in the running event loop."""
        self._loop = asyncio.get_running_loop()
        self._under_way = set[asyncio.Task[Any]]()

    def __len__(self) -> int:
        """Return how many are under way."""
        return len(self._under_way)

    def begin(self, doing: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        """Run a coroutine in the background and return its task."""
        task = self._loop.create_task(doing)
        self._under_way.add(task)
        task.add_done_callback(self._under_way.discard)
        return task

    async def close(self, *, linger: float = 0.0) -> None:
        """Cancel those that do not end within `linger` seconds, and wait until all have ended."""
        if self._under_way and linger:
            await asyncio.wait(self._under_way, timeout=linger)
        while self._under_way:  # one that ends may begin another
            for task in self._under_way:
                task.cancel()
            await asyncio.wait(self._under_way)
