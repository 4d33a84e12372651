"""Async iterators as iterators that block."""

from __future__ import annotations

import asyncio
import time
import weakref
from collections.abc import AsyncGenerator, AsyncIterator, Iterator
from contextlib import suppress
from types import TracebackType
from typing import Generic, Self, TypeVar

from servolink.client import button_events, servo_readings
from servolink.client.readers import SharedIterator
from servolink.client.servo_readings import ServoReading
from servolink.errors import ServolinkError
from servolink.protocol.joystick import ButtonEventResponse
from servolink.sync.loop_thread import LoopThread

T = TypeVar("T")


class _ItemReader(Generic[T]):
    """Reads an async iterator, on the loop. Giving up the wait for an item loses nothing: the next wait goes on."""

    def __init__(self, source: AsyncIterator[T]) -> None:
        """Read `source`, from the first `read` on."""
        self._source = source
        self._next: asyncio.Task[T] | None = None

    async def read(self, seconds: float | None = None) -> list[T]:
        """Return the next item, nothing if none comes within `seconds`. Raise StopAsyncIteration at the end."""
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
            if self._next is pending:  # otherwise another thread was faster: this one waits for the next item
                self._next = None
                return [_result(pending)]

    async def close(self) -> None:
        """End the iterator, and whoever waits for an item."""
        if (pending := self._next) is not None:
            pending.cancel()
            await asyncio.wait((pending,))
        with suppress(ServolinkError):  # the board may be gone
            if isinstance(self._source, AsyncGenerator | SharedIterator):
                await self._source.aclose()

    async def _read(self) -> T:
        return await anext(self._source)


def _mark_as_seen(task: asyncio.Task[T]) -> None:
    """Prevent asyncio from logging an error that nobody waits for any more."""
    if not task.cancelled():
        task.exception()


def _result(task: asyncio.Task[T]) -> T:
    if task.cancelled():  # closed by another thread
        raise StopAsyncIteration
    return task.result()


class BlockingIterator(Iterator[T]):
    """An iterator that waits for its items. `close`, the end of a `with` block and leaving the loop end it.

    Ctrl-C ends the wait, and no item is lost: the next loop over the same iterator continues.
    """

    def __init__(self, thread: LoopThread, source: AsyncIterator[T], owner: object = None) -> None:
        """Iterate over `source` on the loop of `thread`, and keep `owner` alive for it."""
        self._thread = thread
        self._owner = owner
        self._source = source
        self._reader = _ItemReader(source)
        # Holds the source, whose own finalizer would run in the thread that drops the last reference.
        weakref.finalize(self, thread.call_soon, self._reader.close).atexit = False

    def __iter__(self) -> Self:
        """Return the iterator itself."""
        return self

    def __next__(self) -> T:
        """Wait for the next item."""
        try:
            return self._thread.run(self._reader.read)[0]
        except StopAsyncIteration:
            raise StopIteration from None

    def within(self, seconds: float) -> Iterator[T]:
        """Yield the items of the next `seconds` seconds; with 0, those that are there already."""
        end = time.monotonic() + seconds
        with suppress(StopAsyncIteration):
            while items := self._thread.run(self._reader.read, max(0.0, end - time.monotonic())):
                yield from items
                if seconds and time.monotonic() >= end:  # also for a loop that is slower than the items come
                    return

    def close(self) -> None:
        """End the iterator; may be called again."""
        if not self._thread.has_ended:
            self._thread.run(self._reader.close)

    def __enter__(self) -> Self:
        """Return the iterator, which the end of the block closes."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close the iterator. No effect in a forked process, as its board stays with the parent process."""
        if self._thread.is_here:
            self.close()


class ServoReadings(BlockingIterator[ServoReading]):
    """Readings of all servos; `with` or the first one asked for begins to read.

    A program that is too slow gets the latest reading, and `missed` counts the others.
    """

    _source: servo_readings.ServoReadings

    def __repr__(self) -> str:
        """Return rate and state, such as `<ServoReadings at 50 Hz, reading>`."""
        return repr(self._source)

    def __enter__(self) -> Self:
        """Begin to read."""
        self._thread.run(self._source.__aenter__)
        return self


class ButtonEvents(BlockingIterator[ButtonEventResponse]):
    """Button events; `with` or the first event asked for subscribes to them.

    A reader that is too slow loses its oldest events; `dropped` counts them.
    """

    _source: button_events.ButtonEvents

    @property
    def dropped(self) -> int:
        """The number of events that this reader lost because it was too slow."""
        return self._source.dropped

    def __repr__(self) -> str:
        """Return state and counters, such as `<ButtonEvents subscribed, 2 unread, 0 dropped>`."""
        return repr(self._source)

    def __enter__(self) -> Self:
        """Subscribe."""
        self._thread.run(self._source.__aenter__)
        return self
