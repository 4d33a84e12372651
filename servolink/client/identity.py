"""By what a board is known again after a loss: its project id, or one of several while it is not known which."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from servolink.client.link import Link
from servolink.errors import EncodeError, NotFound, Rejected, RequestTimeout
from servolink.protocol.editing import QueryProjectIDRequest

_NOT_DONE = (EncodeError, Rejected, RequestTimeout)
"""After these the board is as it was: nothing was sent, or the board says so."""


class Identity:
    """The project ids that the board may have; with none, which is before it was asked, no board is it."""

    def __init__(self) -> None:
        """Know nothing yet."""
        self._project_ids: frozenset[int] = frozenset()
        self.changes = 0
        """How often it has become another one."""

    def know(self, project_id: int) -> None:
        """Take note of what the board has for certain."""
        self._project_ids = frozenset({project_id})
        self.changes += 1

    def may_have(self, project_id: int) -> None:
        """Reckon with `project_id` besides what the board had."""
        self._project_ids |= {project_id}
        self.changes += 1

    def hear(self, project_id: int, since: int) -> None:
        """Take note of an answer to what was asked when there had been `since` changes."""
        if self.changes == since:
            self.know(project_id)
        else:  # another id was written or given up meanwhile, and may be what the board has now
            self.may_have(project_id)

    @contextmanager
    def changing(self, link: Link, project_id: int) -> Iterator[None]:
        """Reckon with `project_id` too, if what is asked of `link` meanwhile fails and may yet have been done."""
        was_lost = link.answers.ended is not None
        try:
            yield
        except _NOT_DONE:
            raise
        except BaseException:  # cancelled, for one: it may be on its way
            if not was_lost:
                self.may_have(project_id)
            raise

    async def check(self, link: Link) -> None:
        """Ask which board a new link leads to, and know it from then on; NotFound if it is another."""
        request = QueryProjectIDRequest()
        found = (await link.request(request)).project_id
        if found not in self._project_ids:
            known = " or ".join(str(project_id) for project_id in sorted(self._project_ids))
            raise NotFound(f"the board there has project id {found}, not {known}", request)
        self.know(found)
