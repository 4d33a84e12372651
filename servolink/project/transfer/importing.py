"""Import of a project to a board: all decisions before the first written byte, and the rollback."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from pathlib import Path

import msgspec

from servolink.errors import ProjectError, escape
from servolink.project.model import UNFINISHED, Project
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.import_plan import memory_after
from servolink.project.transfer.import_run import ImportRun
from servolink.project.transfer.journal import (
    Digests,
    Journal,
    by_content,
    digests_of,
    journal_of,
    last_import,
    strangers,
)
from servolink.project.transfer.marker import is_same_id
from servolink.project.transfer.pinned import BoardConnection, PinnedConnection
from servolink.project.transfer.read import BoardReader, Content, read_project_id
from servolink.project.transfer.results import ApplyResult, Progress, ProgressCallback
from servolink.project.transfer.writing import check_writable, writes
from servolink.support import computed

_logger = logging.getLogger(__name__)


async def apply_project(
    board: PinnedConnection,
    project: Project,
    *,
    store: BackupStore,
    on_progress: ProgressCallback,
    replace: bool = False,
    backup: bool = True,
    unchecked: bool = False,
    restores: str | None = None,
) -> ApplyResult:
    """Make the content of the board equal to `project`.

    `replace` deletes everything first, otherwise only differences are written. `backup=False` continues
    without a backup. `unchecked` writes records read from a board; `restores` is the name of the backup with these
    records.

    Raise ProjectError, before any change, for a project impossible to write, and for a failed backup; later, if the
    board refuses a part. After any error from `marking` on, and after a cancellation, the next call continues the
    import.
    """
    if restores is None:  # from now on, a rollback undoes this import or nothing
        await asyncio.to_thread(store.begin, board.url)
    await check_writable(board, project, unchecked=unchecked)
    project = board.holdable(project)
    before = await read_project_id(board)
    journals = await asyncio.to_thread(store.journals, before)
    begun = journal_of(journals, before, board.url)
    reader, content = BoardReader(board, on_progress, project), None
    if begun is None or before not in UNFINISHED:
        content = await reader.read("reading", before)
        if content.project_id != before:
            raise _disturbed(board)
        begun = begun or await _begun_without_id(board, content, journals, store)
    if content is not None and begun is None:
        last = await _last_import(journals, content, board.url)
        project_id_bits = board.project_id_bits if last is None else last.project_id_bits
        if not await computed(writes)(content, project) and is_same_id(before, project.project_id, project_id_bits):
            await _finish(last, store)
            await asyncio.to_thread(store.end_beginning, board.url)
            return ApplyResult(changed=False, resumed=False, backup=None)
        await _warn_of_memory(board, content, project)
    saved = await _backup(board, content, begun, store, on_progress, is_needed=backup)
    avoided = [before, project.project_id, *(one.project_id for one in journals), *(one.marker for one in journals)]
    marker = await asyncio.to_thread(store.new_marker, avoided)
    journal = Journal(marker, board.url, project.project_id, None if saved is None else saved.name, restores=restores)
    others = [one for one in journals if one.url == board.url and one is not begun]
    # Files take time. Any program that began an import meanwhile changed the project id first.
    if await read_project_id(board, before) != before:
        raise _disturbed(board)
    run = ImportRun(board, project, journal, store, on_progress, unchecked=unchecked)
    stored_bits = await run.run(reader, content, before, begun, others, replace=replace)
    on_progress(Progress("finishing", 1, 1, f"project id {project.project_id}"))
    return ApplyResult(changed=True, resumed=begun is not None, backup=saved, project_id_bits=stored_bits)


def _disturbed(board: BoardConnection) -> ProjectError:
    return ProjectError(f"{board.url}: another program is writing to the board; try again after it")


async def _begun_without_id(
    board: BoardConnection, content: Content, journals: Sequence[Journal], store: BackupStore
) -> Journal | None:
    """Return the journal of an interrupted import to a board without project ids, recognised by the content."""
    begun = [one for one in journals if one.may_be_of(content.project_id, board.url) and not one.has_written_all]
    if not begun or await by_content(journals, content, board.url, {}, is_over=True):
        return None
    backups = {one.backup: await _digests_in(store, one.backup) for one in begun if one.backup}
    found = await by_content(begun, content, board.url, backups, is_over=False)
    if found is None:
        _logger.warning(
            "an import to %s was interrupted; the board keeps no project id, and holds records from neither before nor "
            "during the import, so perhaps a different board: the import starts over, with a new backup",
            escape(board.url),
        )
    return found


async def _last_import(journals: Sequence[Journal], content: Content, url: str) -> Journal | None:
    return last_import(journals, content.project_id, url) or await by_content(journals, content, url, {}, is_over=True)


async def _digests_in(store: BackupStore, name: str | None) -> Digests:
    """Return the digests of a backup; empty for a missing or unreadable backup."""
    if name is None:
        return {}
    try:
        return await computed(digests_of)(await asyncio.to_thread(store.load, store.path_of(name)))
    except ProjectError:
        return {}


async def _finish(last: Journal | None, store: BackupStore) -> None:
    """Mark the last import as finished, if the import ended before the confirmation by the board."""
    if last is not None and last.phase != "finished":
        await asyncio.to_thread(store.write, msgspec.structs.replace(last, phase="finished"))


async def _warn_of_memory(board: PinnedConnection, content: Content, project: Project) -> None:
    memory = await memory_after(board, content, project)
    if memory is not None and memory.warning:
        _logger.warning("%s: %s", escape(board.url), memory.warning)


# --- backups ----------------------------------------------------------------------------------------------------------


async def _backup(
    board: BoardConnection,
    content: Content | None,
    begun: Journal | None,
    store: BackupStore,
    on_progress: ProgressCallback,
    *,
    is_needed: bool,
) -> Path | None:
    """Return the backup of the board's content before the import; None without a backup."""
    if begun is None:
        return await _save(board, content or Content(), store, on_progress) if is_needed else None
    if content is not None and is_needed and not await _is_saved(content, begun, store):
        # Either a rest of records after clearing the board, or a different board.
        path = await _save(board, content, store, on_progress)
        _logger.warning("the records left on %s are saved in %s", escape(board.url), escape(str(path)))
    if begun.backup is None:
        return None
    path = store.path_of(begun.backup)
    if path.is_file():
        return path
    _logger.warning("the backup of the continued import is missing: %s", escape(str(path)))
    return None


async def _is_saved(content: Content, begun: Journal, store: BackupStore) -> bool:
    """Return whether `content` is free of unsaved records: all are from the backup, or from the import."""
    if content.is_empty():
        return True
    if not begun.target:
        return False
    found = await computed(lambda: digests_of(content.readable()))()
    return not strangers(found, [begun.target, await _digests_in(store, begun.backup)])


async def _save(board: BoardConnection, content: Content, store: BackupStore, on_progress: ProgressCallback) -> Path:
    """Save the content of the board. Raise ProjectError if the board does not return all records."""
    on_progress(Progress("saving", 0, 1, "backup"))
    try:
        old = await computed(content.project)()
    except ProjectError as error:
        raise ProjectError(f"no backup of {board.url} can be made: {error}") from error
    path = await asyncio.to_thread(store.keep, old, board.url, board.codec.caption_encoding)
    on_progress(Progress("saving", 1, 1, "backup"))
    return path


# --- the way back -----------------------------------------------------------------------------------------------------


async def roll_back(
    board: PinnedConnection,
    backup: Path | None,
    *,
    store: BackupStore,
    on_progress: ProgressCallback,
) -> ApplyResult:
    """Restore `backup`, by default of the unfinished import, else of the last import at this address.

    Raise ProjectError without a backup. A rollback is an ordinary import: safe to interrupt, and to roll back.
    """
    path = backup or await backup_for(board, store)
    project = await asyncio.to_thread(store.load, path, board.codec.caption_encoding)
    return await apply_project(
        board,
        project,
        store=store,
        on_progress=on_progress,
        unchecked=True,
        restores=path.name if path == store.path_of(path.name) else None,
    )


async def backup_for(board: BoardConnection, store: BackupStore) -> Path:
    """Return the backup of the board's content before the last import. Raise ProjectError without a backup."""
    if not isinstance(board, PinnedConnection):
        board = PinnedConnection(board, unanswered=getattr(board, "unanswered", ()))
    project_id, url = await read_project_id(board), board.connection.board_url
    journals = await asyncio.to_thread(store.journals, project_id)
    journal = journal_of(journals, project_id, url) or last_import(journals, project_id, url)
    has_begun = await asyncio.to_thread(store.has_begun, url)
    if has_begun and (journal is None or journal.has_written_all):
        raise ProjectError(
            f"the last import to {url} ended before its backup was made, so nothing was changed, and there is nothing "
            "to undo; to undo an earlier import, give `rollback` a backup from `servolink backups`"
        )
    if journal is None and any(one.may_be_of(project_id, url) for one in journals):
        journal = await _import_without_id(board, journals, store)
    if journal is not None and journal.restores is not None and journal.phase != "finished":
        return store.path_of(journal.restores)  # continues an interrupted rollback
    if journal is None:
        why = (
            f"{url} holds an import begun by another computer, or with a lost journal"
            if project_id in UNFINISHED
            else f"no import from this computer gave {url} the project id {project_id}: nothing to undo"
        )
        raise ProjectError(f"{why}; give `rollback` a backup from `servolink backups`, or apply a project")
    if journal.backup is None:
        raise ProjectError(f"the last import to {url} was made without a backup; apply a project")
    return store.path_of(journal.backup)


async def _import_without_id(board: BoardConnection, journals: Sequence[Journal], store: BackupStore) -> Journal:
    """Return the journal of the last import to a board without project ids. Raise ProjectError for unknown content."""
    content = await BoardReader(board, lambda progress: None, Project()).read()
    backups = {one.backup: await _digests_in(store, one.backup) for one in journals if one.backup}
    # Finished imports first: another board at the same address may be in the middle of an import of the same project.
    for is_over in (True, False):
        if found := await by_content(journals, content, board.url, backups, is_over=is_over):
            return found
    raise ProjectError(
        f"{board.url} keeps no project id, and the content differs from the last import by this computer: perhaps "
        "a different board; give `rollback` a backup from `servolink backups`, or apply a project"
    )
