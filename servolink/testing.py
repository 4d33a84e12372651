"""Tests of programs in virtual time: an event loop whose clock jumps to the next timer, so that no test waits."""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """Event loop in which sleeping costs nothing: when nothing is ready, time moves on to the next timer.

    Only for programs in one process: a real board, or another program, needs real time for each response.
    """

    def __init__(self, selector: Callable[[VirtualTimeLoop], selectors.BaseSelector] | None = None) -> None:
        """Start at 1000 seconds; `selector` makes the selector, by default one that never waits."""
        self.now = 1000.0
        """Virtual time in seconds."""
        super().__init__((selector or _JumpingSelector)(self))

    def time(self) -> float:
        """Return the virtual time in seconds."""
        return self.now

    def run_in_executor(self, executor: Any, func: Callable[..., Any], *args: Any) -> asyncio.Future[Any]:  # type: ignore[override]
        """Call `func` at once: work in a thread takes no virtual time."""
        done: asyncio.Future[Any] = self.create_future()
        try:
            done.set_result(func(*args))
        except Exception as error:  # noqa: BLE001 - raised where the result is awaited
            done.set_exception(error)
        return done

    def stall(self, seconds: float) -> None:
        """Let `seconds` pass while the loop is busy, as a blocking call in a callback would."""
        self.now += seconds


class _JumpingSelector(selectors.DefaultSelector):
    def __init__(self, loop: VirtualTimeLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0)
        if ready or timeout == 0:
            return ready
        if timeout is None:
            raise RuntimeError("deadlock: nothing is ready, nothing is timed, and the test still waits")
        self._loop.now += timeout
        return ready


def run(main: Coroutine[Any, Any, T]) -> T:
    """Run `main` in virtual time and return its result. Raise AssertionError if tasks are left behind."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(_without_tasks(main))


async def _without_tasks(main: Coroutine[Any, Any, T]) -> T:
    result = await main
    await asyncio.sleep(0)
    if left := asyncio.all_tasks() - {asyncio.current_task()}:
        raise AssertionError(f"tasks left behind: {left}")
    return result
