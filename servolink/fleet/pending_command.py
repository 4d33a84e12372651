"""PendingCommand: results of boards to a message, with a result from each board."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Iterable
from typing import Any, TypeVar

import msgspec
from msgspec import UNSET

from servolink.errors import RequestError, ServolinkError
from servolink.fleet.topics import BoardResult, TransferStep

T = TypeVar("T")

OnStep = Callable[[TransferStep], None]
"""Called with each step of a long command."""


class PendingCommand:
    """Collector of the results to a message. A second result of a board is a repeated delivery, and ignored."""

    def __init__(self, message_id: str, *, board: str | None = None, on_step: OnStep | None = None) -> None:
        """Wait for results with the id `message_id`, of `board` or of any board."""
        self.id = message_id
        self.results: dict[str, BoardResult] = {}
        """Results by board, in order of arrival."""
        self.seconds: dict[str, float] = {}
        """When each came, in seconds of the clock of the event loop."""
        self._now = asyncio.get_running_loop().time
        self.heard = self._now()
        """Time of the latest arrival, by the loop's clock."""
        self.board = board
        """Board whose results are accepted; None for any board."""
        self.awaited: set[str] = set()
        """Expected boards without a result."""
        self._on_step = on_step
        self._changed = asyncio.Event()

    def take(self, result: BoardResult) -> None:
        """Take a result or a step."""
        if self.board not in {None, result.board}:
            return
        self.heard = self._now()
        if result.progress is not UNSET:
            if self._on_step is not None:
                self._on_step(result.progress)
        elif result.ok is not UNSET and result.board not in self.results:
            self.results[result.board] = result
            self.seconds[result.board] = self.heard
            self.awaited.discard(result.board)
        self._changed.set()

    def wake(self) -> None:
        """End a wait after a reconnection: the message may have to be sent again."""
        self._changed.set()

    async def wait(self, deadline: float) -> bool:
        """Wait for the next result. Return False when `deadline` passes first."""
        try:
            async with asyncio.timeout_at(deadline):
                await self._changed.wait()
        except TimeoutError:
            return False
        self._changed.clear()
        return True

    def expect(self, boards: Iterable[str]) -> None:
        """Await results of `boards`, too."""
        self.awaited.update(board for board in boards if board not in self.results)

    async def until(self, boards: Iterable[str], deadline: float) -> Collection[str]:
        """Wait for the results of `boards` and of expected boards. Return the boards without a result at `deadline`."""
        self.expect(boards)
        while self.awaited and await self.wait(deadline):  # woken by each of thousands of results: no board is examined
            pass
        return self.awaited


def failure_of(result: BoardResult) -> ServolinkError | None:
    """Return the error of the library for a reported failure; None after success."""
    if result.ok is True:
        return None
    if result.error is UNSET:
        return RequestError(f"{result.board} refused, and did not say why")
    return result.error.as_error(f"{result.board}: ")


def result_as(board: str, found: Any, kind: type[T]) -> T:
    """Return the result of a method as `kind`. Raise ServolinkError for a different type."""
    try:
        return msgspec.convert(found, kind)
    except msgspec.ValidationError as error:
        raise ServolinkError(f"{board} sends an answer that this version of servolink cannot read: {error}") from error
