"""Run of an import: the marker, passes to write all differences, and a check after each pass."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Collection, Sequence
from contextlib import suppress
from typing import Any

import msgspec

from servolink.errors import OutcomeUnknown, ProjectError, Rejected, quote
from servolink.project.model import Project
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.journal import Journal, JournalPhase, digests_of
from servolink.project.transfer.marker import Marker, not_stored
from servolink.project.transfer.pinned import BoardConnection, ProjectIDBits
from servolink.project.transfer.read import BoardReader, Content, doubled_types
from servolink.project.transfer.results import Progress, ProgressCallback
from servolink.project.transfer.writing import RecordWriter, Write, items_of, stages
from servolink.protocol import RECORD_TYPES, AddServoParameterRequest, RecordType
from servolink.support import computed

_TRIES = 4
_PASSES = 16
_STUCK = 3
"""Passes in a row with no fewer writes left, until the import gives up."""
_SHORT_LIST = 8192
"""Bytes of a list short enough to read again after each pass, whatever was written."""


class ImportRun:
    """Writes a project to a board, under a journal."""

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
        """Write `target` to the board under `journal`, a new journal for each run."""
        self._board = board
        self._target = target
        self._journal = journal
        self._store = store
        self._on_progress = on_progress
        self._unchecked = unchecked
        self._marker = Marker(board, journal.marker, on_progress)

    async def run(
        self,
        reader: BoardReader,
        content: Content | None,
        before: int,
        begun: Journal | None,
        others: Sequence[Journal],
        *,
        replace: bool,
    ) -> ProjectIDBits:
        """Write everything, and return the number of marker bits kept by the board. Raise ProjectError after a refusal.

        `content` was read by `reader`, None before any reading; `before` is the project id on the board. `begun` is the
        journal of the interrupted run, if any, and `others` are all other journals of this address.
        """
        over = [one for one in others if one.has_written_all]  # the present run replaces the last import
        if self._journal.restores is None:  # a rollback lost before any change to the board is asked for again
            await self._end(over)
        await self._note("writing")
        await asyncio.to_thread(self._store.end_beginning, self._board.url)
        await self._mark(before)
        await self._end(over if begun is None else [*over, begun])  # the marker of `begun` has left every board
        if replace:
            content = await self._clear(reader)
        await self._write_all(reader, content)
        for one in others:
            if one.phase == "clearing":  # a different board is at this address now
                await asyncio.to_thread(self._store.write, msgspec.structs.replace(one, phase="writing"))
        await self._note("finishing")
        await self._marker.finish(self._target.project_id)
        await self._note("finished")
        return self._marker.bits

    async def _note(self, phase: JournalPhase) -> None:
        self._journal = msgspec.structs.replace(self._journal, phase=phase)
        await asyncio.to_thread(self._store.write, self._journal)

    async def _end(self, journals: Sequence[Journal]) -> None:
        for one in journals:
            await asyncio.to_thread(self._store.end, one)

    async def _mark(self, before: int) -> None:
        """Write the marker. Record the signs to recognise a board that does not keep the whole marker."""
        await self._marker.put(before)
        if self._marker.bits != 32:
            # Recorded before any other change: without the whole marker, a later run needs these values.
            self._journal = msgspec.structs.replace(
                self._journal,
                project_id_bits=self._marker.bits,
                constant_id=self._marker.found if self._marker.bits == 0 else 0,
                target=await computed(digests_of)(self._target),
            )
            await self._note("writing")

    async def _clear(self, reader: BoardReader) -> Content:
        """Delete everything, and return the rest: servo parameters on some boards."""
        await self._note("clearing")
        self._on_progress(Progress("clearing", 0, 1, "everything on the board"))
        for _ in range(_TRIES):
            with suppress(Rejected, OutcomeUnknown):
                await self._board.clear_all_data()
            await self._marker.restore("clearing")  # the board may have deleted the project id too
            content = await reader.read("clearing", self._marker.found)
            if not any(content.records.values()):
                await self._note("writing")
                return content
        raise ProjectError(
            not_stored(self._board, "the command to delete all data (without `replace` it is not needed)")
        )

    async def _write_all(self, reader: BoardReader, content: Content | None) -> None:
        """Write all differences, in passes, until the board matches the target."""
        writer = RecordWriter(self._board, reader, self._on_progress, self._marker.keep, unchecked=self._unchecked)
        if content is None:
            await self._marker.keep()
            content = await reader.read("verifying", self._marker.found)
        todo: list[Write] = []
        same = 0
        for remaining in range(_PASSES, -1, -1):
            work = await computed(stages)(content, self._target)
            before, todo = todo, [write for stage in work for write in stage]
            if not todo:
                return
            same = 0 if len(todo) < len(before) or items_of(todo) != items_of(before) else same + 1
            if same == _STUCK or not remaining or (before and _moves_records(content, todo)):
                break
            lists = doubled_types(content) | await computed(self._lists_worth_reading)(content, todo)
            await writer.run(work, lists)
            content = await self._check(reader, writer, lists)
        raise ProjectError(not_stored(self._board, _explain_failed_writes(content, todo, writer.refused)))

    async def _check(self, reader: BoardReader, writer: RecordWriter, lists: set[RecordType[Any]]) -> Content:
        """Return the content of the board after a pass.

        Each added record was read back, and all other records were read before. The lists show the rest: remaining
        deleted records, duplicates, records under another id. Everything is read again after a write with success
        reported but no effect on the record, and after a change of the project id by another program.
        """
        is_exclusive = await self._marker.keep()
        if writer.is_suspicious or not is_exclusive:
            return await reader.read("verifying", self._marker.found)
        return await reader.check("verifying", self._marker.found, lists | writer.doubtful)

    def _lists_worth_reading(self, content: Content, todo: Sequence[Write]) -> set[RecordType[Any]]:
        """Return the types with a list no longer than the writing to check, or short in any case."""
        sizes: Counter[RecordType[Any]] = Counter()
        for write in todo:
            if write.record_type is not None:
                sizes[write.record_type] += len(self._board.codec.encode(write.request, unchecked=True))
        counts = {each: max(len(content.records[each]), len(each.by_id(self._target))) for each in RECORD_TYPES}
        return {each for each in RECORD_TYPES if each.list_size(counts[each]) <= max(_SHORT_LIST, sizes[each])}


_MOST = 3
_ELSEWHERE = "stored under another id"


def _explain_failed_writes(content: Content, todo: Sequence[Write], refused: Collection[str]) -> str:
    """Return the writes of `todo` still missing with `content` on the board, the first writes with a reason.

    `refused` are the items refused by the board.
    """
    found = {write.item: _reason(content, write, refused) for write in todo}
    words = [f"{item} ({reason})" if reason else item for item, reason in found.items()]
    words.sort(key=lambda word: _ELSEWHERE not in word)
    text = ", ".join(words[:_MOST]) + (f" and {len(words) - _MOST} more" if len(words) > _MOST else "")
    is_full = any(write.item in refused and write.record is not None for write in todo)
    return f"{text}, perhaps because its memory is full" if is_full else text


def _reason(content: Content, write: Write, refused: Collection[str]) -> str:
    request: Any = write.request
    if write.item in refused:
        if isinstance(request, AddServoParameterRequest):
            return "refused; does the board have all these servos?"
        return "refused"
    if isinstance(request, AddServoParameterRequest):
        servo_ids = [one.servo_id for one in request.servos if one not in content.servo_parameters]
        return f"servo {servo_ids[0]} comes back changed" if servo_ids else ""
    if write.record_type is None:
        return ""
    return "still listed" if write.record is None else _difference(content, write.record_type, write)


def _difference(content: Content, record_type: RecordType[Any], write: Write) -> str:
    """Return the difference between the record returned by the board and the written record."""
    entries = [entry for entry in content.records[record_type] if entry.record_id == write.record_id]
    if not entries:
        elsewhere = _id_elsewhere(content, record_type, write)
        return f"{_ELSEWHERE}, as {record_type} {elsewhere}" if elsewhere is not None else "missing afterwards"
    found = entries[0].record
    if found is None:
        return "listed and not returned"
    if len(entries) > 1:
        return f"listed {len(entries)} times"
    if (caption := record_type.caption_of(found)) != record_type.caption_of(write.record):
        return f"the caption comes back as {quote(caption)}"
    return f"other {record_type.record_class.__struct_fields__[-1]} come back"


def _id_elsewhere(content: Content, record_type: RecordType[Any], write: Write) -> int | None:
    """Return the id under which a written record is stored in place of its own; None without one."""
    written: Any = write.record
    contents = msgspec.structs.astuple(written)[1:]  # the id comes first
    found = {each.record_id: each.record for each in content.records[record_type] if each.record is not None}
    return next((found_id for found_id, one in found.items() if msgspec.structs.astuple(one)[1:] == contents), None)


def _moves_records(content: Content, todo: Sequence[Write]) -> bool:
    """Return whether the board stores added records under ids of its own: each further write leaves another one."""
    adding = [write for write in todo if write.record_type is not None and write.record is not None]
    return bool(adding) and all(
        write.record_id not in content.ids_of(write.record_type)
        and _id_elsewhere(content, write.record_type, write) is not None
        for write in adding
        if write.record_type is not None
    )
