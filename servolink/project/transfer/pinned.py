"""Board as seen by a transfer: a single connection, with several requests under way."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Iterable
from contextlib import AbstractContextManager
from typing import Any, Literal, Protocol, TypeAlias, TypeVar

from servolink.errors import ConnectionLost
from servolink.protocol.codec import Codec
from servolink.protocol.packet import Request, Response

ProjectIDBits: TypeAlias = Literal[32, 16, 0]
"""Number of project id bits kept by a board; 0: the board returns the same number after any write."""

T = TypeVar("T")
R = TypeVar("R", bound=Response)


class TransferConnection(Protocol):
    """Connection to a board, as far as needed by a transfer."""

    @property
    def board_url(self) -> str:
        """Address of the board without any hub, to recognise imports to this board."""
        ...

    @property
    def depth_bound(self) -> int:
        """Maximum number of queries ever under way."""
        ...

    @property
    def write_depth_bound(self) -> int:
        """Maximum number of requests ever under way while a request changes the board."""
        ...

    @property
    def pace(self) -> float:
        """Known rate of the line in bytes per second, 0 if unknown."""
        ...

    def bulk(self) -> AbstractContextManager[None]:
        """Return a context for the transfer of much data."""
        ...


class BoardConnection(Protocol):
    """Connected board, as far as needed by projects."""

    @property
    def url(self) -> str:
        """Address of the board."""
        ...

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding of the connection."""
        ...

    @property
    def connection(self) -> TransferConnection:
        """Present connection: another object after a loss."""
        ...

    def request(self, packet: Request[R], *, unchecked: bool = False) -> Coroutine[Any, Any, R]:
        """Return the response to `packet`."""
        ...

    async def write_project_id(self, project_id: int) -> None:
        """Write the project id."""

    async def clear_all_data(self) -> None:
        """Delete everything."""


class PinnedConnection:
    """Passes requests on. Raise ConnectionLost after any change of the connection, even to the same address."""

    def __init__(
        self, board: BoardConnection, memory_unit: int | None = None, project_id_bits: ProjectIDBits | None = None
    ) -> None:
        self.memory_unit = memory_unit
        """Bytes per unit in the board's memory figures; None if unknown."""
        self.project_id_bits: ProjectIDBits | None = project_id_bits
        """Number of project id bits kept by the board; None if unknown."""
        self._board = board
        self.connection = board.connection
        self.url = board.connection.board_url
        """Address of the board without any hub in between."""

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
                f"the connection to {self.url} was lost and restored in the middle of the transfer, perhaps to "
                "another board; start the transfer again"
            )
        return self._board


async def in_parallel(items: Iterable[T], work: Callable[[T], Awaitable[None]], depth: int) -> None:
    """Do `work` for each item, started in order, with as many at a time as `depth` requests need.

    The first error ends all work and is raised.
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
            # A worker beyond the depth: the request waits in the queue, and is sent as soon as another is answered.
            for _ in range(depth + 1):
                group.create_task(worker())
    except BaseExceptionGroup as errors:
        raise errors.exceptions[0] from None
