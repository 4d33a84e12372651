"""The board as far as a transfer needs it: one connection, and several requests under way on it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Iterable
from contextlib import AbstractContextManager
from typing import Any, Literal, Protocol, TypeAlias, TypeVar

from servolink.errors import ConnectionLost
from servolink.protocol.codec import Codec
from servolink.protocol.packet import Request, Response

ProjectIDBits: TypeAlias = Literal[32, 16, 0]
"""How many bits of a project id a board keeps; with 0 it returns the same number whatever is written."""

T = TypeVar("T")
R = TypeVar("R", bound=Response)


class TransferConnection(Protocol):
    """A connection, as far as it concerns a transfer."""

    @property
    def board_url(self) -> str:
        """The address of the board itself, by which its imports are known."""
        ...

    @property
    def depth_bound(self) -> int:
        """How many queries may ever be under way."""
        ...

    @property
    def write_depth_bound(self) -> int:
        """How many requests may ever be under way while one of them is a change."""
        ...

    @property
    def pace(self) -> float:
        """Bytes per second that the line is known to carry, 0 if they are unknown."""
        ...

    def bulk(self) -> AbstractContextManager[None]:
        """Return a context in which much is transferred."""
        ...


class BoardConnection(Protocol):
    """A connected board, as far as projects need one."""

    @property
    def url(self) -> str:
        """The address."""
        ...

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding of the connection."""
        ...

    @property
    def connection(self) -> TransferConnection:
        """The present connection: another object after a loss."""
        ...

    def request(self, packet: Request[R], *, unchecked: bool = False) -> Coroutine[Any, Any, R]:
        """Return the response to `packet`."""
        ...

    async def write_project_id(self, project_id: int) -> None:
        """Write the project id."""

    async def clear_all_data(self) -> None:
        """Delete everything."""


class PinnedConnection:
    """Passes requests on. Raise ConnectionLost once the connection is another one, even to the same address."""

    def __init__(
        self, board: BoardConnection, memory_unit: int | None = None, project_id_bits: ProjectIDBits | None = None
    ) -> None:
        """Speak to `board` through the connection that it has now."""
        self.memory_unit = memory_unit
        """Bytes in the unit in which the board counts its memory; None if it is unknown."""
        self.project_id_bits = project_id_bits
        """How many bits of a project id the board keeps; None if it is unknown."""
        self._board = board
        self.connection = board.connection
        self.url = board.connection.board_url
        """The address of the board itself, whether or not a hub is in between."""

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding of the connection."""
        return self._board.codec

    async def request(self, packet: Request[R], *, unchecked: bool = False) -> R:
        """Return the response to `packet`."""
        return await self._pinned().request(packet, unchecked=unchecked)

    async def write_project_id(self, project_id: int) -> None:
        """Write the project id."""
        await self._pinned().write_project_id(project_id)

    async def clear_all_data(self) -> None:
        """Delete everything."""
        await self._pinned().clear_all_data()

    def _pinned(self) -> BoardConnection:
        if self._board.connection is not self.connection:
            raise ConnectionLost(
                f"the connection to {self.url} was lost and came back in the middle of this, perhaps to "
                "another board; do it again"
            )
        return self._board


async def in_parallel(items: Iterable[T], work: Callable[[T], Awaitable[None]], depth: int) -> None:
    """Do `work` for each item, begun in their order, so many at a time that `depth` requests can be under way.

    The first error ends all of it and is raised.
    """
    waiting = iter(items)

    async def worker() -> None:
        for item in waiting:
            await work(item)

    if depth == 1:
        await worker()
        return
    try:
        async with asyncio.TaskGroup() as group:
            # One more than the depth: its request waits in the queue, and is sent the moment another is answered.
            for _ in range(depth + 1):
                group.create_task(worker())
    except BaseExceptionGroup as errors:
        raise errors.exceptions[0] from None
