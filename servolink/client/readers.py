"""Async iterators of which any number share one source on the board, such as a subscription."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import AsyncIterator
from contextlib import suppress
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from servolink.connection.explain import same
from servolink.errors import ConnectionLost

T = TypeVar("T")
ReaderT = TypeVar("ReaderT", bound="Reader[Any]")


class Reader(Generic[T]):
    """The items that one iterator has not read yet."""

    def __init__(self, limit: int) -> None:
        """Keep the latest `limit` items."""
        self.items: deque[T] = deque(maxlen=limit)
        self.changed = asyncio.Event()
        self.dropped = 0
        """Items lost because the iterator was too slow."""
        self.ended = False
        self.error: Exception | None = None

    def put(self, item: T) -> bool:
        """Add an item. Return whether the oldest one was dropped for it."""
        drops = len(self.items) == self.items.maxlen
        self.dropped += drops
        self.items.append(item)
        self.changed.set()
        return drops

    def end(self, error: Exception | None = None) -> None:
        """End the iterator behind the items that are there: with `error`, quietly if this program has ended it."""
        self.ended = True
        self.error = error
        with suppress(RuntimeError):  # the reader's loop has ended, and nobody can be woken
            self.changed.set()

    def raise_end(self) -> None:
        """Raise what the iterator ends with."""
        if self.error is None or (isinstance(self.error, ConnectionLost) and self.error.__cause__ is None):
            raise StopAsyncIteration  # the program has closed the board
        raise same(self.error) if isinstance(self.error, ConnectionLost) else self.error


class Source(ABC, Generic[ReaderT]):
    """What gives items to its readers."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        """Give items in `loop`."""
        self._loop = loop

    @abstractmethod
    async def join(self, reader: ReaderT) -> None:
        """Give items to `reader` from now on."""

    @abstractmethod
    async def leave(self, reader: ReaderT) -> None:
        """Give `reader` no further items."""

    @abstractmethod
    def leave_soon(self, reader: ReaderT) -> None:
        """Leave in the background, for callers in the loop that cannot await."""

    def leave_later(self, reader: ReaderT) -> None:
        """Leave when the loop has its next turn: Python calls finalizers anywhere, and in any thread."""
        with suppress(RuntimeError):  # the loop has ended, and nobody reads any more
            self._loop.call_soon_threadsafe(self.leave_soon, reader)


class SharedIterator(AsyncIterator[T], Generic[T, ReaderT]):
    """An iterator over a source; `async with`, or simply `async for`, joins and leaves it."""

    def __init__(self, source: Source[ReaderT]) -> None:
        """Join `source` when the first item is asked for."""
        self._joined = False
        self._source = source
        self._reader = self._new_reader()

    @abstractmethod
    def _new_reader(self) -> ReaderT:
        """Return a reader that has not joined."""

    def __aiter__(self) -> Self:
        """Return the iterator itself."""
        return self

    async def __anext__(self) -> T:
        """Return the next item, waiting for it if necessary."""
        await self._join()
        reader = self._reader
        while not reader.items:
            if reader is not self._reader:  # another task joined for both, failed, and left a fresh reader
                return await anext(self)
            if reader.ended:
                reader.raise_end()
            reader.changed.clear()
            await reader.changed.wait()
        item: T = reader.items.popleft()
        return item

    async def __aenter__(self) -> Self:
        """Join."""
        await self._join()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Leave."""
        await self.aclose()

    async def aclose(self) -> None:
        """Leave, and end the iterator."""
        if self._joined and not self._reader.ended:
            await self._source.leave(self._reader)
        self._reader.ended = True

    def __del__(self) -> None:
        """Leave after `break` has left an `async for` loop."""
        if getattr(self, "_joined", False):  # it is not there if the arguments were refused
            self._source.leave_later(self._reader)

    async def _join(self) -> None:
        if not self._joined and not self._reader.ended:
            self._joined = True
            reader = self._reader
            try:
                await self._source.join(reader)
            except BaseException:  # the next read tries again
                if not reader.ended:
                    self._joined, self._reader = False, self._new_reader()
                raise
