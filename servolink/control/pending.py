"""PendingCalls: requests that wait for their response."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

K = TypeVar("K")
T = TypeVar("T")


class PendingCalls(Generic[K, T]):
    """Pending calls by id, until response, cancellation or the end of the connection."""

    def __init__(self) -> None:
        """Start without any."""
        self._futures: dict[K, asyncio.Future[T]] = {}

    @contextmanager
    def expect(self, call_id: K) -> Iterator[asyncio.Future[T]]:
        """Yield the response to await; send the request in this context."""
        future: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        self._futures[call_id] = future
        try:
            yield future
        finally:
            self._futures.pop(call_id, None)

    def settle(self, call_id: K, response: T) -> None:
        """Wake the caller of a response, unless the call has ended."""
        future = self._futures.get(call_id)
        if future is not None and not future.done():
            future.set_result(response)

    def fail_all(self, error: Callable[[], Exception]) -> None:
        """Raise a new error in each caller: the connection has ended."""
        for future in self._futures.values():
            if not future.done():
                future.set_exception(error())
