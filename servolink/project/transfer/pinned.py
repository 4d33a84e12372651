"""Board as seen by a transfer: a single connection, with several requests under way."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Collection, Coroutine, Iterable
from contextlib import AbstractContextManager
from typing import Any, Literal, Protocol, TypeAlias, TypeVar

import msgspec

from servolink.errors import ConnectionLost, escape
from servolink.project.model import Project
from servolink.protocol import PACKETS, Codec, Request, Response, layout

ProjectIDBits: TypeAlias = Literal[32, 16, 0]
"""Number of project id bits kept by a board; 0: the board returns the same number after any write."""

_FIELDS = {
    "QueryProjectID": "project_id",
    "QueryServoParameter": "servo_parameters",
    "QueryActionList": "actions",
    "QueryMacroList": "macros",
    "QueryJoystickTableList": "joystick_tables",
    "QueryActiveJoystickTable": "active_joystick_table",
}
"""Field of a project read with each query."""
_logger = logging.getLogger(__name__)

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
        self,
        board: BoardConnection,
        memory_unit: int | None = None,
        project_id_bits: ProjectIDBits | None = None,
        unanswered: Collection[str] = (),
    ) -> None:
        self.memory_unit = memory_unit
        """Bytes per unit in the board's memory figures; None if unknown."""
        self.project_id_bits: ProjectIDBits | None = project_id_bits
        """Number of project id bits kept by the board; None if unknown."""
        self.absent = [query for query in _FIELDS if query in unanswered]
        """Queries that the board does not answer, such as `QueryProjectID`."""
        if self.absent:
            _logger.warning("%s does not answer %s: left out", escape(board.url), ", ".join(self.absent))
        self._board = board
        self.connection = board.connection
        self.url = board.connection.board_url
        """Address of the board without any hub in between."""

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding of the connection."""
        return self._board.codec

    async def request(self, packet: Request[R], *, unchecked: bool = False) -> R:
        """Return the response to `packet`; an empty response to a query that the board does not answer."""
        if type(packet).__name__.removesuffix("Request") in self.absent:
            empty = layout(PACKETS.response_of(packet), self.codec.byte_order)
            nothing: Any = empty.decode(bytes(empty.size()), self.codec.caption_encoding)
            return nothing  # type: ignore[no-any-return]  # the response to that query
        return await self._pinned().request(packet, unchecked=unchecked)

    async def write_project_id(self, project_id: int) -> None:
        """Write the project id, unless it cannot be read back."""
        if "QueryProjectID" not in self.absent:
            await self._pinned().write_project_id(project_id)

    async def clear_all_data(self) -> None:
        """Delete everything."""
        await self._pinned().clear_all_data()

    def holdable(self, project: Project) -> Project:
        """Return `project` without the parts that the board cannot be asked for."""
        changes: dict[str, Any] = {_FIELDS[query]: getattr(Project(), _FIELDS[query]) for query in self.absent}
        return msgspec.structs.replace(project, **changes)

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
