"""Why what was written to a board is not there, in words."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Sequence
from contextlib import suppress
from typing import Any

import msgspec

from servolink.errors import OutcomeUnknown, ProjectError, Rejected
from servolink.escaping import quote
from servolink.project.model import Project, is_unfinished
from servolink.project.transfer.backups import BackupStore, Journal, JournalPhase
from servolink.project.transfer.plan import Write, writes
from servolink.project.transfer.read import BoardConnection, Content, read_content, read_project_id
from servolink.project.transfer.results import Phase, Progress, ProgressCallback
from servolink.protocol.editing import AddServoParameterRequest
from servolink.protocol.record_types import RECORD_TYPES, RecordType

_MOST = 3


def explain_failed_writes(content: Content, todo: Sequence[Write], refused: Collection[str]) -> str:
    """Return what of `todo` is still to be done with `content` on the board, the first of it with a reason each.

    `refused` are the items to which the board said no.
    """
    found = {write.item: _reason(content, write, refused) for write in todo}
    words = [f"{item} ({reason})" if reason else item for item, reason in found.items()]
    return ", ".join(words[:_MOST]) + (f" and {len(words) - _MOST} more" if len(words) > _MOST else "")


def _reason(content: Content, write: Write, refused: Collection[str]) -> str:
    request: Any = write.request
    if write.item in refused:
        return "refused; has it all these servos?" if isinstance(request, AddServoParameterRequest) else "refused"
    if isinstance(request, AddServoParameterRequest):
        servo_ids = [one.servo_id for one in request.servos if one not in content.servo_parameters]
        return f"servo {servo_ids[0]} comes back otherwise" if servo_ids else ""
    for kind in RECORD_TYPES:
        if isinstance(request, kind.delete_class):
            return "still listed"
        if isinstance(request, kind.add_class):
            return _difference(content, kind, request)
    return ""


def _difference(content: Content, kind: RecordType[Any], request: Any) -> str:
    """Return what is another in the record that the board gives than in the one that it was given."""
    record_id = kind.id_of(request)
    entries = [entry for entry in content.records[kind] if entry.record_id == record_id]
    if not entries:
        return "not there afterwards"
    given = entries[0].record
    if given is None:
        return "listed and not given"
    if len(entries) > 1:
        return f"listed {len(entries)} times"
    if (caption := kind.caption_of(given)) != kind.caption_of(request):
        return f"its caption comes back as {quote(caption)}"
    return f"other {kind.record_class.__struct_fields__[-1]} come back"


_TRIES = 4
_PASSES = 16
_STUCK = 3
"""After so many passes that left the same to do, or more of it, it will not be done."""


class Import:
    """Writes one project to one board, under a journal."""

    def __init__(
        self,
        board: BoardConnection,
        target: Project,
        journal: Journal,
        store: BackupStore,
        on_progress: ProgressCallback,
        *,
        unchecked: bool,
    ) -> None:
        """Bring `target` to the board under `journal`, which is a new one for each run."""
        self._board = board
        self._target = target
        self._journal = journal
        self._store = store
        self._on_progress = on_progress
        self._exact = unchecked

    async def run(
        self, content: Content | None, before: int, begun: Journal | None, others: Sequence[Journal], *, replace: bool
    ) -> None:
        """Write everything; ProjectError if it is not taken.

        `content` is what is on the board, if that is known, and `before` its project id. `begun` is the journal of
        the run that was interrupted, if there was one, `others` are all the others of this address.
        """
        over = [one for one in others if one.has_written_all]  # the last import here is now this one
        if self._journal.restores is None:  # a rollback that is lost before it has changed anything is asked for again
            await self._end(over)
        await self._note("writing")
        await self._mark(before)
        await self._end(over if begun is None else [*over, begun])  # no board has the marker of `begun` any more
        if replace:
            content = await self._clear()
        await self._write_all(content)
        for one in others:
            if one.phase == "clearing":  # that board is no longer at this address
                await asyncio.to_thread(self._store.write, msgspec.structs.replace(one, phase="writing"))
        await self._note("finishing")
        await self._write_id(self._target.project_id, "finishing")
        await self._note("finished")

    async def _note(self, phase: JournalPhase) -> None:
        self._journal = msgspec.structs.replace(self._journal, phase=phase)
        await asyncio.to_thread(self._store.write, self._journal)

    async def _end(self, journals: Sequence[Journal]) -> None:
        for one in journals:
            await asyncio.to_thread(self._store.end, one)

    async def _mark(self, before: int) -> None:
        """Write the marker; ProjectError, and all is as it was before, if the board does not keep it."""
        marker = self._journal.marker
        if await self._keeps_id(marker, "marking"):
            return
        restored = await self._keeps_id(before, "marking")
        await asyncio.to_thread(self._store.end, self._journal)
        raise ProjectError(
            f"{self._board.url} does not keep project ids such as {marker}, by which an unfinished import "
            f"is known; nothing was changed{'' if restored else ' but its project id'}"
        )

    async def _write_id(self, project_id: int, phase: Phase) -> None:
        if not await self._keeps_id(project_id, phase):
            raise self._not_taken(f"project id {project_id}")

    async def _keeps_id(self, project_id: int, phase: Phase) -> bool:
        self._on_progress(Progress(phase, 0, 1, f"project id {project_id}"))
        for _ in range(_TRIES):
            with suppress(Rejected, OutcomeUnknown):  # what the board says next is what counts
                await self._board.write_project_id(project_id)
            if await read_project_id(self._board) == project_id:
                return True
        return False

    async def _clear(self) -> Content:
        await self._note("clearing")
        self._on_progress(Progress("clearing", 0, 1, "everything on the board"))
        for _ in range(_TRIES):
            with suppress(Rejected, OutcomeUnknown):
                await self._board.clear_all_data()
            # It may have deleted the project id as well.
            await self._write_id(self._journal.marker, "clearing")
            content = await read_content(self._board, self._on_progress, "clearing")
            if not any(content.records.values()):
                await self._note("writing")
                return content
        raise self._not_taken("the command to delete all data (without `replace` it is not needed)")

    async def _write_all(self, content: Content | None) -> None:
        """Write what differs until a reading shows that nothing does."""
        content = content or await self._verified()
        todo: list[Write] = []
        refused: set[str] = set()
        same = 0
        for left in range(_PASSES, -1, -1):
            before, todo = todo, writes(content, self._target)
            if not todo:
                return
            same = 0 if len(todo) < len(before) or _items(todo) != _items(before) else same + 1
            if same == _STUCK or not left:
                break
            refused = await self._pass(todo)
            content = await self._verified()
        raise self._not_taken(explain_failed_writes(content, todo, refused))

    async def _verified(self) -> Content:
        content = await read_content(self._board, self._on_progress, "verifying")
        await self._stay_alone(content.project_id)
        return content

    async def _stay_alone(self, project_id: int) -> None:
        """Keep the marker on the board; ProjectError if another import has put its own there."""
        if project_id == self._journal.marker:
            return
        if is_unfinished(project_id):
            raise ProjectError(
                f"another program has begun to import to {self._board.url} in the middle of this import; "
                "let one of them do it"
            )
        await self._write_id(self._journal.marker, "verifying")

    async def _pass(self, todo: list[Write]) -> set[str]:
        """Do it all; return what the board refused."""
        refused = set()
        for at, write in enumerate(todo):
            self._on_progress(Progress("writing", at, len(todo), write.item))
            with suppress(OutcomeUnknown):  # the next reading tells
                answer = await self._board.request(write.request, unchecked=self._exact)
                if not answer.result:
                    refused.add(write.item)
        self._on_progress(Progress("writing", len(todo), len(todo), todo[-1].item))
        return refused

    def _not_taken(self, what: str) -> ProjectError:
        return ProjectError(
            f"{self._board.url} does not take {what}; the import is unfinished: apply a project that it "
            "takes, or roll back"
        )


def _items(todo: list[Write]) -> set[str]:
    return {write.item for write in todo}
