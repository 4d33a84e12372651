"""Thread of the event loop of `servolink.sync`, and calls from other threads to the loop."""

from __future__ import annotations

import asyncio
import atexit
import os
import sys
import threading
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, Generic, ParamSpec, TypeVar

from servolink.errors import ServolinkError
from servolink.support import WAIT

P = ParamSpec("P")
T = TypeVar("T")

_CANCEL_LIMIT = 0.5  # seconds for a call to end after Ctrl-C
_EXIT_LIMIT = 3.0  # seconds for all boards to close at the end of the program


class _LoopCall(Generic[T]):
    """Call of an async function, made in one thread and run on the loop of another thread."""

    def __init__(self, function: Callable[[], Awaitable[T]]) -> None:
        self._function = function
        self._task: asyncio.Task[None] | None = None
        self._ended: SimpleQueue[None] = SimpleQueue()
        self.result: T  # set without an error
        self.error: BaseException | None = None

    def start(self) -> None:
        """Start the call. Runs on the loop."""
        self._task = asyncio.get_running_loop().create_task(self._run())

    def cancel(self) -> None:
        """Cancel the call. Runs on the loop."""
        if self._task is None or self._task.done():
            self._ended.put(None)
        else:
            self._task.cancel()

    def wait(self) -> None:
        """Wait until the call has ended. Runs in the thread of the caller."""
        while True:
            with suppress(Empty):
                return self._ended.get(timeout=WAIT)

    def wait_after_cancel(self) -> None:
        """Wait until a cancelled call has ended, at most 0.5 s."""
        with suppress(Empty):
            self._ended.get(timeout=_CANCEL_LIMIT)

    async def _run(self) -> None:
        try:
            self.result = await self._function()
        except BaseException as error:  # noqa: BLE001 - belongs to the caller; raised here, SystemExit ends the loop
            self.error = error
        finally:
            self._ended.put(None)


class LoopThread:
    """Daemon thread with an event loop, running until the program ends."""

    def __init__(self) -> None:
        self._process = os.getpid()
        self._loop: asyncio.AbstractEventLoop
        self._end: asyncio.Event
        self.at_exit: set[Callable[[], Awaitable[None]]] = set()
        """Functions called at the end of the program; to be changed on the loop only."""
        self.has_ended = False
        """Whether the program is ending, and all boards are closed."""
        started = threading.Event()
        self._thread = threading.Thread(target=self._own, args=[started], name="servolink.sync", daemon=True)
        self._thread.start()
        started.wait()
        # Boards are closed before the program ends: a daemon thread is killed at any point of its work.
        atexit.register(self._end_with_program)

    @property
    def is_here(self) -> bool:
        """Whether the thread belongs to this process, not to the process before a fork."""
        return self._process == os.getpid()

    def run(self, function: Callable[P, Awaitable[T]], *args: P.args, **kwargs: P.kwargs) -> T:
        """Call an async function on the loop, wait for the end, and return its result or raise its error.

        Ctrl-C cancels the call. Raise RuntimeError in a callback on the loop, in a forked process, and at the end of
        the program.
        """
        self._check()
        call = _LoopCall(partial(function, *args, **kwargs))
        try:
            self._loop.call_soon_threadsafe(call.start)
            call.wait()
        except BaseException:  # Ctrl-C, or the exception of another signal handler
            self._loop.call_soon_threadsafe(call.cancel)
            call.wait_after_cancel()
            raise
        if call.error is None:
            return call.result
        try:
            raise _shortened(call.error)
        finally:
            del call  # breaks a reference cycle of the error and its traceback

    def call_soon(self, function: Callable[P, Coroutine[Any, Any, None]], *args: P.args, **kwargs: P.kwargs) -> None:
        """Call an async function on the loop without waiting. No effect in a forked process, or at the end."""
        if self.is_here and not self.has_ended:
            call = _LoopCall(partial(function, *args, **kwargs))
            with suppress(RuntimeError):  # the loop was closed in the meantime
                self._loop.call_soon_threadsafe(call.start)

    def _check(self) -> None:
        """Raise RuntimeError if the current thread or process cannot call the loop, or the loop has ended."""
        if not self.is_here:
            raise RuntimeError(
                "this board was connected before the process was forked, and stays with the parent process: "
                "connect in the child process, or start the child with multiprocessing's method 'spawn'"
            )
        if threading.current_thread() is self._thread:
            raise RuntimeError(
                "a callback such as on_progress cannot call servolink.sync: callbacks run in the thread of the event "
                "loop, and the loop would wait for itself"
            )
        if self.has_ended:
            raise RuntimeError("the program is ending, and all boards of servolink.sync are closed")

    def _own(self, started: threading.Event) -> None:
        # Not asyncio.Runner: its `close` starts a thread, too late at the end of the program.
        loop = asyncio.new_event_loop()
        loop.run_until_complete(self._serve(started))
        loop.close()

    async def _serve(self, started: threading.Event) -> None:
        self._loop = asyncio.get_running_loop()
        self._end = asyncio.Event()
        started.set()
        await self._end.wait()
        await asyncio.gather(*(close() for close in self.at_exit), return_exceptions=True)
        left = asyncio.all_tasks() - {asyncio.current_task()}
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)
        await self._loop.shutdown_asyncgens()

    def _end_with_program(self) -> None:
        """Close all boards and end the thread; give up after 3 s."""
        if self.is_here:
            self.has_ended = True
            self._loop.call_soon_threadsafe(self._end.set)
            with suppress(KeyboardInterrupt):
                self._thread.join(_EXIT_LIMIT)


def _shortened(error: BaseException) -> BaseException:
    """Return an error of servolink without the frames inside servolink; `python -X dev` shows all frames."""
    if isinstance(error, ServolinkError) and not sys.flags.dev_mode:
        return error.with_traceback(None)
    return error


_starting = threading.Lock()
_thread: LoopThread | None = None


def running_thread() -> LoopThread:
    """Return the thread for the process, started on first use."""
    global _thread  # noqa: PLW0603 - one for the process
    with _starting:
        if _thread is None or not _thread.is_here:
            _thread = LoopThread()
        return _thread
