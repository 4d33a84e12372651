"""BoardSharing: the contract between a connection and the link to the hub of a shared board."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from contextlib import AbstractAsyncContextManager
from typing import Protocol, TypeAlias

from servolink.motion.limits import MotionLimits

SendPoints: TypeAlias = Callable[[Mapping[int, float], float], Awaitable[Mapping[int, int]]]
"""Sends set-points that must leave by a time of the event loop's clock. Returns the angles sent, by servo."""


class BoardSharing(Protocol):
    """Requests to the hub of a shared board, beside requests to the board."""

    has_lost_board: bool
    """Whether the hub has lost the board, and is reconnecting."""
    on_board: Callable[[bool], None]
    """Called with `has_lost_board` when the hub loses or finds the board."""

    async def stop(self) -> None:
        """Stop all servos; return when the hub has read all of them as stopped."""

    def stream(self, hz: float, gap: float, limits: MotionLimits) -> SendPoints:
        """Return a function to stream set-points through the hub, which shortens them to `limits` and its own."""
        ...

    def moving(self) -> AbstractAsyncContextManager[None]:
        """Return a context with the lease of the servos; raises MotionRefused on entry if another program has it."""
        ...

    def exclusive(self, reason: str) -> AbstractAsyncContextManager[None]:
        """Return a context with exclusive use of the board."""
        ...

    async def close(self) -> None:
        """Leave the hub, which frees the lease."""
