"""Work in the background: tasks with an owner, and long computations in a thread."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial, wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def computed(work: Callable[P, T]) -> Callable[P, Coroutine[Any, Any, T]]:
    """Return a coroutine function that does `work` in a thread, one computation at a time.

    Work with large projects goes here, as a stop must not wait for the event loop. Nothing may change the arguments
    meanwhile.
    """

    @wraps(work)
    async def compute(*args: P.args, **kwargs: P.kwargs) -> T:
        return await asyncio.get_running_loop().run_in_executor(_thread(), partial(work, *args, **kwargs))

    return compute


@cache
def _thread() -> ThreadPoolExecutor:
    """Return the thread for all: each further one at work would delay an event loop by a time slice of Python."""
    return ThreadPoolExecutor(1, "servolink computing")


class Tasks:
    """Set of background tasks. References are kept here: the event loop keeps weak references only."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._under_way = set[asyncio.Task[Any]]()

    def __len__(self) -> int:
        """Return the number of unfinished tasks."""
        return len(self._under_way)

    def begin(self, doing: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        """Run a coroutine in the background and return its task."""
        task = self._loop.create_task(doing)
        self._under_way.add(task)
        task.add_done_callback(self._under_way.discard)
        return task

    @staticmethod
    async def shared_result(task: asyncio.Future[T]) -> T:
        """Return the result of a task that others wait for, too: a cancelled caller does not cancel the task.

        `asyncio.shield` would log, in Python 3.14, an error after the cancellation, although others have been told.
        """
        await asyncio.wait((task,))
        return task.result()

    async def close(self, *, linger: float = 0.0) -> None:
        """Cancel tasks still running after `linger` seconds, and wait until all tasks have ended."""
        if self._under_way and linger:
            await asyncio.wait(self._under_way, timeout=linger)
        while self._under_way:  # a task may begin another task at its end
            for task in self._under_way:
                task.cancel()
            await asyncio.wait(self._under_way)
