"""Restoring a lost connection: its states, attempts in growing pauses, and recognition of the board."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from servolink.errors import EncodeError, NotFound, Rejected, RequestTimeout, ServolinkError
from servolink.pauses import Pauses, Reconnecting
from servolink.protocol.editing import QueryProjectIDRequest

if TYPE_CHECKING:
    from servolink.connection.packet_connection import PacketConnection
    from servolink.control.status import ConnectionState

_NOT_DONE = (EncodeError, Rejected, RequestTimeout)
"""After these errors the board is unchanged: nothing was sent, or the board says so."""
SETTLES_AFTER = 3.0
"""Seconds until a write lasts: a board that loses power sooner may come back without the write."""
_logger = logging.getLogger(__name__)


class ConnectionStates:
    """The state of a connection, for any number of readers."""

    def __init__(self) -> None:
        """Start in the state `connected`."""
        self.now: ConnectionState = "connected"
        self._readers: list[asyncio.Queue[ConnectionState]] = []

    def change(self, state: ConnectionState) -> None:
        """Pass a new state to every reader; `closed` is final."""
        if self.now not in {state, "closed"}:
            self.now = state
            for reader in self._readers:
                with suppress(RuntimeError):  # the reader's loop has ended, and nobody can be woken
                    reader.put_nowait(state)

    async def read(self) -> AsyncGenerator[ConnectionState, None]:
        """Yield the present state and then each change, up to `closed`."""
        reader: asyncio.Queue[ConnectionState] = asyncio.Queue()
        reader.put_nowait(self.now)
        self._readers.append(reader)
        try:
            state: ConnectionState | None = None
            while state != "closed":
                state = await reader.get()
                yield state
        finally:
            self._readers.remove(reader)


class Reconnector:
    """Attempts to reopen a board in the background, in growing intervals."""

    def __init__(
        self,
        open_connection: Callable[[], Awaitable[PacketConnection]],
        resume: Callable[[PacketConnection], Awaitable[None]],
        on_another: Callable[[str], None],
    ) -> None:
        """Connect with `open_connection`; `resume` then restores the session, or raises on failure.

        `on_another` is called with a description when another board answers, and with no text when that has ended.
        """
        self._open_connection = open_connection
        self._resume = resume
        self._on_another = on_another
        self._pauses = Pauses()
        self._wrong_board = ""
        self._task: asyncio.Task[None] | None = None
        self._stopped = False

    def start(self) -> bool:
        """Start to reconnect, unless under way. Return False after `stop`, when nothing is started."""
        if not self._stopped and (self._task is None or self._task.done()):
            self._task = asyncio.get_running_loop().create_task(self._until_connected())
        return not self._stopped

    async def stop(self) -> None:
        """Cancel reconnecting, and never begin again."""
        self._stopped = True
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait((self._task,))

    async def _until_connected(self) -> None:
        self._pauses.restart()
        self._wrong_board = ""
        await self._pauses.wait()
        await anext(Reconnecting(self._reopen, self._pauses, self._retry))

    def _retry(self, error: Exception) -> bool:
        if not isinstance(error, ServolinkError):
            # A defect of ours or of a third-party transport. A board on a robot should come back all the same.
            _logger.error(
                "unexpected error while reconnecting; next attempt in %g s", self._pauses.next, exc_info=error
            )
            return True
        # Not plugged in yet, or still busy: expected, so only a trace in the log.
        _logger.debug("cannot reconnect yet, next attempt in %g s: %s", self._pauses.next, error)
        wrong_board = str(error) if isinstance(error, NotFound) else ""
        if wrong_board != self._wrong_board:
            if wrong_board:  # nobody would find out why the lost board never comes back
                _logger.warning("%s; still waiting for the board that was lost", wrong_board)
            self._wrong_board = wrong_board
            self._on_another(wrong_board)
        return True

    async def _reopen(self) -> None:
        connection = await self._open_connection()
        try:
            await self._resume(connection)
        except BaseException:
            await connection.close()  # or the next attempt finds the port busy
            raise


class BoardIdentity:
    """Possible project ids of the board; several after a write with an unknown outcome.

    A board has no serial number in the protocol, so it is recognised by its project id.
    """

    def __init__(self) -> None:
        """Start without a project id; no board matches."""
        self._project_ids: frozenset[int] = frozenset()
        self.changes = 0
        """How many times the set of possible ids has changed."""
        self._former: list[tuple[frozenset[int], float]] = []
        """Possible ids before each recent change of the board, and when the change is surely stored."""

    def set(self, project_id: int) -> None:
        """Record the known id of the board."""
        self._project_ids = frozenset({project_id})
        self.changes += 1

    def add(self, project_id: int) -> None:
        """Record a further possible id."""
        self._project_ids |= {project_id}
        self.changes += 1

    def changes_now(self, now: float) -> None:
        """Record a confirmed change of the id at `now`, before `set` or `add`.

        The board may keep the change in memory for a moment before it outlives a loss of power.
        """
        self._former = [(ids, until) for ids, until in self._former if until > now]
        self._former.append((self._project_ids, now + SETTLES_AFTER))

    def lost(self, now: float) -> None:
        """Record a loss of the connection at `now`, perhaps with a loss of power."""
        for ids, until in self._former:
            if until > now:
                self._project_ids |= ids
        self.changes += 1

    def learn(self, project_id: int, since: int) -> None:
        """Record the response to a query sent when `changes` was `since`."""
        if self.changes == since:
            self.set(project_id)
        else:
            # Another id was written, or a write was cancelled, while the query was under way. The response may be
            # older than that, so it only adds a possibility.
            self.add(project_id)

    @contextmanager
    def changing(self, connection: PacketConnection, project_id: int) -> Iterator[None]:
        """Add `project_id` if the request in the body fails with an unknown outcome."""
        was_lost = connection.ended is not None
        try:
            yield
        except _NOT_DONE:
            raise
        except BaseException:  # a cancelled request may have been sent
            if not was_lost:
                self.add(project_id)
            raise

    async def check(self, connection: PacketConnection) -> None:
        """Read and record the project id on a new connection. Raise NotFound for another board."""
        request = QueryProjectIDRequest()
        found = (await connection.request(request)).project_id
        if found not in self._project_ids:
            expected = " or ".join(str(project_id) for project_id in sorted(self._project_ids))
            url = connection.url
            raise NotFound(f"the board at {url} has project id {found}, not {expected}, so it is another one", request)
        self.set(found)
