"""One run of an import: marker, passes, verification, project id.

Each step can be repeated, and each leaves behind what the next run needs (docs/design/projects.md).
"""

from __future__ import annotations

import asyncio
from contextlib import suppress

import msgspec

from servolink.errors import OutcomeUnknown, ProjectError, Rejected
from servolink.printable import printable
from servolink.project.journal import Journal, JournalPhase
from servolink.project.model import Project
from servolink.project.progress import Phase, Progress, Tell
from servolink.project.read import Asked, Content, read_content, read_project_id
from servolink.project.store import Store, digest_of
from servolink.project.writes import Write, writes

_TRIES = 4
_PASSES = 16
_STUCK = 3
"""After so many passes that left the same to do, it will not be done."""


class Import:
    """Writes one project to one board, under a journal."""

    def __init__(
        self, board: Asked, target: Project, journal: Journal, store: Store, tell: Tell, *, exact: bool
    ) -> None:
        """Go on with `journal`, whatever it was about, towards `target`."""
        self._board = board
        self._target = target
        self._journal = msgspec.structs.replace(journal, url=board.url, digest=digest_of(target))
        self._store = store
        self._tell = tell
        self._exact = exact

    async def run(self, content: Content | None, *, replace: bool) -> None:
        """Write everything; `content` is what is on the board, if that is known. ProjectError if it is not taken."""
        await self._note("clearing" if replace else self._journal.phase)
        await self._write_id(self._journal.marker, "marking")
        if replace:
            content = await self._clear()
        await self._note("writing")
        await self._write_all(content)
        await self._write_id(self._target.project_id, "finishing")

    async def _note(self, phase: JournalPhase) -> None:
        self._journal = msgspec.structs.replace(self._journal, phase=phase)
        try:
            await asyncio.to_thread(self._store.write, self._journal)
        except OSError as error:
            raise ProjectError(f"the journal of the import cannot be written: {printable(str(error))}") from error

    async def _write_id(self, project_id: int, phase: Phase) -> None:
        self._tell(Progress(phase, 0, 1, f"project id {project_id}"))
        for _ in range(_TRIES):
            with suppress(Rejected, OutcomeUnknown):  # what the board says next is what counts
                await self._board.write_project_id(project_id)
            if await read_project_id(self._board) == project_id:
                return
        raise self._not_taken(f"project id {project_id}")

    async def _clear(self) -> Content:
        self._tell(Progress("clearing", 0, 1, "everything on the board"))
        for _ in range(_TRIES):
            with suppress(Rejected, OutcomeUnknown):
                await self._board.clear_all_data()
            content = await read_content(self._board, self._tell, "clearing")
            if not any(content.records.values()):
                # It may have deleted the project id as well.
                await self._write_id(self._journal.marker, "clearing")
                return content
        raise self._not_taken("the command to delete all data")

    async def _write_all(self, content: Content | None) -> None:
        """Write what differs until a reading shows that nothing does."""
        before: list[Write] = []
        same = 0
        for _ in range(_PASSES):
            if content is None:
                content = await read_content(self._board, self._tell, "verifying")
            todo = writes(content, self._target)
            if not todo:
                return
            same = same + 1 if todo == before else 0
            if same == _STUCK:
                break
            await self._pass(todo)
            before, content = todo, None
        raise self._not_taken(", ".join(write.item for write in before[:3]) + (" and more" if len(before) > 3 else ""))

    async def _pass(self, todo: list[Write]) -> None:
        for at, write in enumerate(todo):
            self._tell(Progress("writing", at, len(todo), write.item))
            with suppress(OutcomeUnknown):  # the next reading tells
                await self._board.request(write.request, exact=self._exact)
        self._tell(Progress("writing", len(todo), len(todo), todo[-1].item))

    def _not_taken(self, what: str) -> ProjectError:
        return ProjectError(
            f"{printable(self._board.url)} does not take {what}; the import is unfinished: apply a project that it "
            "takes, or roll back"
        )
