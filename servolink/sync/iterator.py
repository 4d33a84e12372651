"""Blocking iterators over the items of async iterators."""

from __future__ import annotations

import asyncio
import time
import weakref
from collections.abc import AsyncGenerator, AsyncIterator, Iterator
from contextlib import suppress
from math import isnan
from types import TracebackType
from typing import Generic, Self, TypeVar

from servolink import client
from servolink.client import ServoReading, SharedIterator
from servolink.errors import ServolinkError, quote
from servolink.protocol import ButtonEventResponse
from servolink.support import as_number, is_number
from servolink.sync.loop_thread import LoopThread

T = TypeVar("T")


class _ItemReader(Generic[T]):
    """Reader of an async iterator, on the loop. An abandoned wait loses no item: the next wait continues."""

    def __init__(self, source: AsyncIterator[T]) -> None:
        """Prepare to read `source`; the first call of `read` begins."""
        self._source = source
        self._next: asyncio.Task[T] | None = None

    async def read(self, seconds: float | None = None) -> list[T]:
        """Return the next item, an empty list after `seconds` without an item. Raise StopAsyncIteration at the end."""
        loop = asyncio.get_running_loop()
        end = None if seconds is None else loop.time() + seconds
        while True:
            if self._next is None:
                self._next = loop.create_task(self._read())
                self._next.add_done_callback(_mark_as_seen)
            pending = self._next
            await asyncio.wait((pending,), timeout=None if end is None else max(0.0, end - loop.time()))
            if not pending.done():
                return []
            if self._next is pending:  # otherwise another thread took the item, and the loop waits for the next
                self._next = None
                return [_result(pending)]

    async def close(self) -> None:
        """End the iterator, and all waits for an item."""
        if (pending := self._next) is not None:
            pending.cancel()
            await asyncio.wait((pending,))
        with suppress(ServolinkError):  # the connection may be lost
            if isinstance(self._source, AsyncGenerator | SharedIterator):
                await self._source.aclose()

    async def _read(self) -> T:
        return await anext(self._source)


def _mark_as_seen(task: asyncio.Task[T]) -> None:
    """Prevent asyncio from logging the error of an abandoned wait."""
    if not task.cancelled():
        task.exception()


def _result(task: asyncio.Task[T]) -> T:
    if task.cancelled():  # closed by another thread
        raise StopAsyncIteration
    return task.result()


class BlockingIterator(Iterator[T]):
    """Iterator that waits for its items, ended by `close`, by the end of a `with` block, and by leaving the loop.

    Ctrl-C ends the wait, and no item is lost: the next loop over the same iterator continues.
    """

    def __init__(self, thread: LoopThread, source: AsyncIterator[T], owner: object = None) -> None:
        """Iterate over `source` on the loop of `thread`; keep `owner` alive as long as the iterator."""
        self._thread = thread
        self._owner = owner
        self._source = source
        self._reader = _ItemReader(source)
        # The finalizer holds the source, whose own finalizer would run in the thread of the last reference.
        weakref.finalize(self, thread.call_soon, self._reader.close).atexit = False

    def __iter__(self) -> Self:
        """Return the iterator itself."""
        return self

    def __next__(self) -> T:
        """Wait for the next item, and return the item."""
        try:
            return self._thread.run(self._reader.read)[0]
        except StopAsyncIteration:
            raise StopIteration from None

    def within(self, seconds: float) -> Iterator[T]:
        """Return an iterator over the items of the next `seconds` seconds; with 0, only items already received.

        Raise TypeError or ValueError if `seconds` is not a number.
        """
        if not is_number(seconds := as_number(seconds)):
            raise TypeError(f"seconds must be a number of seconds, not {quote(seconds)}")
        if isnan(seconds):
            raise ValueError(f"seconds must be a number of seconds, not {quote(seconds)}")
        return self._within(seconds)

    def _within(self, seconds: float) -> Iterator[T]:
        end = time.monotonic() + seconds
        with suppress(StopAsyncIteration):
            while items := self._thread.run(self._reader.read, max(0.0, end - time.monotonic())):
                yield from items
                if seconds and time.monotonic() >= end:  # ends also if items arrive faster than the loop runs
                    return

    def close(self) -> None:
        """End the iterator; may be called again."""
        if not self._thread.has_ended:
            self._thread.run(self._reader.close)

    def __enter__(self) -> Self:
        """Return the iterator, closed at the end of the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close the iterator. No effect in a forked process: the board stays with the parent process."""
        if self._thread.is_here:
            self.close()


class ServoReadings(BlockingIterator[ServoReading]):
    """Iterator over readings of all servos; `with` or the first item starts reading.

    A slow program gets the latest reading; `missed` counts the readings in between.
    """

    _source: client.ServoReadings

    def __repr__(self) -> str:
        """Return rate and state, such as `<ServoReadings at 50 Hz, reading>`."""
        return repr(self._source)

    def __enter__(self) -> Self:
        """Start to read the servos, and return the iterator."""
        self._thread.run(self._source.__aenter__)
        return self


class ButtonEvents(BlockingIterator[ButtonEventResponse]):
    """Iterator over button events; `with` or the first item subscribes to the events.

    A slow program loses the oldest events; `dropped` counts the lost events.
    """

    _source: client.ButtonEvents

    @property
    def dropped(self) -> int:
        """Number of events lost because the program was too slow."""
        return self._source.dropped

    def __repr__(self) -> str:
        """Return state and counters, such as `<ButtonEvents subscribed, 2 unread, 0 dropped>`."""
        return repr(self._source)

    def __enter__(self) -> Self:
        """Subscribe to button events, and return the iterator."""
        self._thread.run(self._source.__aenter__)
        return self
