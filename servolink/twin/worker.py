"""Process of low priority for physics, so that a program with an event loop never waits for it."""

from __future__ import annotations

import asyncio
import itertools
import multiprocessing
import os
import signal
from collections.abc import AsyncGenerator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.process import BaseProcess
from typing import Any, Final, NamedTuple, Protocol, TypeVar

from servolink.errors import TwinError

NICENESS: Final = 10
"""Niceness of the process, where the system knows it."""

_PATIENCE = 1.0  # seconds for the present piece at the end of the program
_ENDED = "the process with the physics was ended from outside; try again"

T = TypeVar("T")


class _Pipe(Protocol):
    """End of a pipe, which has another type on Windows."""

    def send(self, value: Any, /) -> None: ...

    def recv(self) -> Any: ...

    def close(self) -> None: ...


class _WorkerOrder(NamedTuple):
    """Order for the process: begin a job, continue it if there is no function, or end it."""

    number: int
    begin: Callable[..., Iterator[Any]] | None = None
    arguments: tuple[Any, ...] = ()
    ends: bool = False


class Worker:
    """Process that carries out jobs piece by piece: generators, whose pieces take turns.

    The process starts with the first job, and again if it was ended from outside.
    """

    def __init__(self) -> None:
        """Start nothing yet."""
        self._thread = ThreadPoolExecutor(1, "twin")  # one exchange with the process at a time
        self._pipe: _Pipe | None = None
        self._process: BaseProcess | None = None
        self._numbers = itertools.count()
        self._urgent = 0
        self._calm = asyncio.Event()
        self._calm.set()

    async def run(
        self, job: Callable[..., Iterator[T]], *arguments: Any, is_background: bool = False
    ) -> AsyncGenerator[T, None]:
        """Yield the pieces of a job; a background job pauses while others run.

        Args:
            job: Generator function of a module, whose arguments and pieces can be pickled.
            arguments: Arguments of the job.
            is_background: Whether nobody waits for the job.

        Raises:
            TwinError: The process was ended from outside.
            ServolinkError: Error of the job.
        """
        number = next(self._numbers)
        order = _WorkerOrder(number, job, arguments)
        self._note_urgent(0 if is_background else 1)
        try:
            while True:
                if is_background:
                    await self._calm.wait()
                piece = await self._exchange(order)
                if piece is None:
                    return
                order = _WorkerOrder(number)
                yield piece
        finally:
            self._note_urgent(0 if is_background else -1)
            with suppress(RuntimeError):  # closed already
                self._thread.submit(self._end, number)

    async def close(self) -> None:
        """End the process after its present piece, or within a second."""
        ending = asyncio.ensure_future(asyncio.to_thread(self._thread.shutdown, cancel_futures=True))
        await asyncio.wait((ending,), timeout=_PATIENCE)
        if not ending.done() and self._process is not None:
            self._process.terminate()
        await ending
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = None

    def _note_urgent(self, change: int) -> None:
        self._urgent += change
        if self._urgent:
            self._calm.clear()
        else:
            self._calm.set()

    async def _exchange(self, order: _WorkerOrder) -> Any:
        answer = await asyncio.get_running_loop().run_in_executor(self._thread, self._send, order)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _end(self, number: int) -> None:
        if self._pipe is not None:
            self._send(_WorkerOrder(number, ends=True))

    def _send(self, order: _WorkerOrder) -> Any:
        """Return the answer to an order; an error is an answer, too."""
        try:
            if self._pipe is None:
                self._pipe, self._process = _start()
            self._pipe.send(order)
            return self._pipe.recv()
        except (EOFError, OSError):
            if self._pipe is not None:
                self._pipe.close()
                self._pipe = None
            return TwinError(_ENDED)


def _start() -> tuple[_Pipe, BaseProcess]:
    """Start a process, and return the pipe to it, with which it ends, and the process."""
    # A fork would copy the threads of the program half-way through their work.
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there,), name="servolink twin", daemon=True)
    process.start()
    there.close()
    return here, process


def _serve(pipe: _Pipe) -> None:
    """Carry out orders until the other end of the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the program ends its processes
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    jobs = dict[int, Iterator[Any]]()
    with suppress(EOFError, OSError):
        while True:
            pipe.send(_answer(jobs, pipe.recv()))


def _answer(jobs: dict[int, Iterator[Any]], order: _WorkerOrder) -> Any:
    """Return the next piece of a job, None at its end."""
    if order.ends:
        jobs.pop(order.number, None)
        return None
    try:
        job = jobs.pop(order.number, None) if order.begin is None else order.begin(*order.arguments)
        if job is None:  # of an earlier process
            return TwinError(_ENDED)
        if (piece := next(job, None)) is not None:
            jobs[order.number] = job
    except Exception as error:  # noqa: BLE001 - whatever a job raises is an answer
        return error
    return piece
