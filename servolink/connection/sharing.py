"""BoardSharing: the contract between a connection and the link to the hub of a shared board."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import Protocol


class BoardSharing(Protocol):
    """Requests to the hub of a shared board, beside those to the board."""

    has_lost_board: bool
    """Whether the hub has lost the board, and tries to get it back."""
    on_board: Callable[[bool], None]
    """Called with `has_lost_board` when the hub tells that."""

    async def stop(self) -> None:
        """Stop all servos; return when the hub has read that they are stopped."""

    def moving(self) -> AbstractAsyncContextManager[None]:
        """Return a context with the right to move the servos; entering it raises MotionRefused if another has it."""
        ...

    def alone(self, reason: str) -> AbstractAsyncContextManager[None]:
        """Return a context in which no other program uses the board."""
        ...

    async def close(self) -> None:
        """Leave the hub."""
