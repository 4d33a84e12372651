"""Parallel work on boards, several at a time; a failure on a board does not end the work on others."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Iterable
from typing import Generic, TypeVar

from servolink.errors import ServolinkError

T = TypeVar("T")

Work = Callable[[str], Awaitable[T]]
"""Work on the board of the given name; raises ServolinkError on failure."""


class Outcomes(Generic[T]):
    """Outcomes of the work on each board."""

    def __init__(self) -> None:
        self.done: dict[str, T] = {}
        """Results by board, in the order in which the work ended."""
        self.failed: dict[str, ServolinkError] = {}
        """Error for each board with failed work."""
        self.skipped: tuple[str, ...] = ()
        """Boards whose work was not begun, because another board had failed."""

    @property
    def is_complete(self) -> bool:
        """Whether the work was done for every board."""
        return not (self.failed or self.skipped)


async def for_each(
    boards: Iterable[str],
    work: Work[T],
    *,
    parallel: int,
    fail_fast: bool = False,
    on_outcome: Callable[[str, ServolinkError | None], None] = lambda board, error: None,
) -> Outcomes[T]:
    """Do the work for each board, for `parallel` boards at a time.

    With `fail_fast`, begin nothing more after a failure; what was begun goes on to its end. `on_outcome` is called
    with each board as soon as its work has ended, and the error if it failed.
    """
    outcomes: Outcomes[T] = Outcomes()
    waiting = deque(dict.fromkeys(boards))

    async def worker() -> None:
        while waiting and not (fail_fast and outcomes.failed):
            board, error = waiting.popleft(), None
            try:
                outcomes.done[board] = await work(board)
            except ServolinkError as raised:
                outcomes.failed[board] = error = raised
            on_outcome(board, error)

    async with asyncio.TaskGroup() as group:
        for _ in range(min(parallel, len(waiting))):
            group.create_task(worker())
    outcomes.skipped = tuple(waiting)
    return outcomes
