"""Recognition of a board after a loss of the connection, by the project id."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from servolink.connection import PacketConnection
from servolink.errors import EncodeError, NotFound, Rejected, RequestTimeout
from servolink.protocol import QueryProjectIDRequest

_NOT_DONE = (EncodeError, Rejected, RequestTimeout)
"""After these errors the board is unchanged: nothing was sent, or the board says so."""
SETTLES_AFTER = 3.0
"""Seconds until a write lasts: a board that loses power sooner may come back without the write."""


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
