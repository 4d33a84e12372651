"""Async iterators over a shared source on the board, such as a subscription."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import AsyncIterator
from contextlib import suppress
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from servolink.errors import ConnectionLost

T = TypeVar("T")
ReaderT = TypeVar("ReaderT", bound="Reader[Any]")


class Reader(Generic[T]):
    """Unread items of an iterator."""

    def __init__(self, limit: int) -> None:
        """Keep the latest `limit` items."""
        self.items: deque[T] = deque(maxlen=limit)
        self.changed = asyncio.Event()
        self.dropped = 0
        """Items lost because the iterator was too slow."""
        self.ended = False
        self.error: Exception | None = None

    def put(self, item: T) -> bool:
        """Add an item. Return whether the oldest item was dropped."""
        drops = len(self.items) == self.items.maxlen
        self.dropped += drops
        self.items.append(item)
        self.changed.set()
        return drops

    def end(self, error: Exception | None = None) -> None:
        """End the iterator behind the unread items: with `error`, or quietly after an end by this program."""
        self.ended = True
        self.error = error
        with suppress(RuntimeError):  # the reader's loop has ended, and nobody can be woken
            self.changed.set()

    def raise_end(self) -> None:
        """Raise the error at the end of the iterator."""
        if self.error is None or (isinstance(self.error, ConnectionLost) and self.error.__cause__ is None):
            raise StopAsyncIteration  # the program has closed the board
        raise self.error.copy() if isinstance(self.error, ConnectionLost) else self.error


class Source(ABC, Generic[ReaderT]):
    """Source of items for readers."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop

    @abstractmethod
    async def join(self, reader: ReaderT) -> None:
        """Deliver items to `reader` from now on."""

    @abstractmethod
    async def leave(self, reader: ReaderT) -> None:
        """Give `reader` no further items."""

    @abstractmethod
    def leave_soon(self, reader: ReaderT) -> None:
        """Leave in the background, for callers in the loop outside coroutines."""

    def leave_later(self, reader: ReaderT) -> None:
        """Leave when the loop has its next turn: Python calls finalizers anywhere, and in any thread."""
        with suppress(RuntimeError):  # the loop has ended, and nobody reads any more
            self._loop.call_soon_threadsafe(self.leave_soon, reader)


class SharedIterator(AsyncIterator[T], Generic[T, ReaderT]):
    """Iterator over a source; `async with`, or simply `async for`, joins and leaves."""

    def __init__(self, source: Source[ReaderT]) -> None:
        self._joined = False
        self._source = source
        self._reader = self._new_reader()

    @abstractmethod
    def _new_reader(self) -> ReaderT:
        """Return a new reader of all later items."""

    def __aiter__(self) -> Self:
        """Return the iterator itself."""
        return self

    async def __anext__(self) -> T:
        """Wait for the next item and return it."""
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
        """Join: keep items for this reader from now on."""
        await self._join()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Leave: keep no further items for this reader."""
        await self.aclose()

    async def aclose(self) -> None:
        """Leave, and end the iterator."""
        if self._joined and not self._reader.ended:
            await self._source.leave(self._reader)
        self._reader.ended = True

    def __del__(self) -> None:
        """Leave after `break` has left an `async for` loop."""
        if getattr(self, "_joined", False):  # the attribute is missing after refused arguments
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
