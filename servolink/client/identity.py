"""Which board this is: a board has no serial number in the protocol, so it is recognised by its project id."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from servolink.connection.connection import Connection
from servolink.errors import EncodeError, NotFound, Rejected, RequestTimeout
from servolink.protocol.editing import QueryProjectIDRequest

_NOT_DONE = (EncodeError, Rejected, RequestTimeout)
"""After these errors the board is unchanged: nothing was sent, or the board says so."""
SETTLES_AFTER = 3.0
"""Seconds for which a write may not last: a board that loses power sooner may come back as it was before."""


class BoardIdentity:
    """The project ids that the board may have now; more than one after a write whose outcome is unknown."""

    def __init__(self) -> None:
        """Start with no project id, which matches no board."""
        self._project_ids: frozenset[int] = frozenset()
        self.changes = 0
        """How many times the set of possible ids has changed."""
        self._former: list[tuple[frozenset[int], float]] = []
        """The possible ids before each of the latest changes of the board, and when it has surely stored the change."""

    def set(self, project_id: int) -> None:
        """Record the one id that the board is known to have."""
        self._project_ids = frozenset({project_id})
        self.changes += 1

    def add(self, project_id: int) -> None:
        """Record an id that the board may have, besides those it may have already."""
        self._project_ids |= {project_id}
        self.changes += 1

    def changes_now(self, now: float) -> None:
        """Record that the board confirmed a change of its id at `now`, before `set` or `add`.

        It may keep the change in its memory for a moment before that outlives a loss of power.
        """
        self._former = [(ids, until) for ids, until in self._former if until > now]
        self._former.append((self._project_ids, now + SETTLES_AFTER))

    def lost(self, now: float) -> None:
        """Record that the connection was lost at `now`, perhaps as the board has lost power."""
        for ids, until in self._former:
            if until > now:
                self._project_ids |= ids
        self.changes += 1

    def learn(self, project_id: int, since: int) -> None:
        """Record the response to a query that was sent when `changes` was `since`."""
        if self.changes == since:
            self.set(project_id)
        else:
            # Another id was written, or a write was cancelled, while the query was under way. The response may be
            # older than that, so it only adds a possibility.
            self.add(project_id)

    @contextmanager
    def changing(self, connection: Connection, project_id: int) -> Iterator[None]:
        """Add `project_id` if the request made in the body fails in a way that leaves open whether it was done."""
        was_lost = connection.ended is not None
        try:
            yield
        except _NOT_DONE:
            raise
        except BaseException:  # a cancelled request may have been sent
            if not was_lost:
                self.add(project_id)
            raise

    async def check(self, connection: Connection) -> None:
        """Ask a new connection for its project id and record it. Raise NotFound if it is another board."""
        request = QueryProjectIDRequest()
        found = (await connection.request(request)).project_id
        if found not in self._project_ids:
            known = " or ".join(str(project_id) for project_id in sorted(self._project_ids))
            url = connection.transport.url
            raise NotFound(f"the board at {url} has project id {found}, not {known}, so it is another one", request)
        self.set(found)
