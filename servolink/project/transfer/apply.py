"""A project onto a board: what is settled before the first byte is written, and when all of it is done."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

import msgspec

from servolink.errors import ProjectError
from servolink.escaping import escape
from servolink.project.model import Project, is_unfinished
from servolink.project.transfer.backups import BackupStore, Journal, journal_of, last_import
from servolink.project.transfer.import_run import Import
from servolink.project.transfer.plan import check_writable, writes
from servolink.project.transfer.read import BoardConnection, Content, read_content, read_project_id
from servolink.project.transfer.results import ApplyResult, Progress, ProgressCallback
from servolink.protocol.settings import QueryMemorySizeRequest


async def apply_project(
    board: BoardConnection,
    project: Project,
    *,
    store: BackupStore,
    on_progress: ProgressCallback,
    replace: bool = False,
    backup: bool = True,
    unchecked: bool = False,
    restores: str | None = None,
) -> ApplyResult:
    """Make the board hold `project`.

    `replace` deletes everything first (document, 4.2), otherwise only what differs is written. `backup=False` goes on
    without a backup. `unchecked` writes what was read from a board; `restores` names the backup that it is.
    ProjectError, before anything is changed, for a project that cannot be written or does not fit, and if no backup
    can be made; later, if the board does not take it. After any error from `marking` on, and after a cancellation,
    the next call goes on.
    """
    check_writable(board, project, unchecked=unchecked)
    before = await read_project_id(board)
    journals = await asyncio.to_thread(store.journals, before)
    begun = journal_of(journals, before, board.url)
    content = None
    if begun is None or not is_unfinished(before):
        content = await read_content(board, on_progress)
        if content.project_id != before:
            raise ProjectError(f"{board.url}: another program is writing to the board; try again after it")
    if content is not None and begun is None:
        if not writes(content, project) and before == project.project_id:
            await _finish(last_import(journals, before, board.url), store)
            return ApplyResult(changed=False, resumed=False, backup=None)
        await _check_memory(board, content, project)
    kept = await _backup(board, content, begun, store, on_progress, wanted=backup)
    name = None if kept is None else kept.name
    marker = await asyncio.to_thread(store.new_marker)
    journal = Journal(marker, board.url, project.project_id, name, restores=restores)
    others = [one for one in journals if one.url == board.url and one is not begun]
    run = Import(board, project, journal, store, on_progress, unchecked=unchecked)
    await run.run(content, before, begun, others, replace=replace)
    on_progress(Progress("finishing", 1, 1, f"project id {project.project_id}"))
    return ApplyResult(changed=True, resumed=begun is not None, backup=kept)


async def _finish(last: Journal | None, store: BackupStore) -> None:
    """Note that the last import is done, if it could not see that itself."""
    if last is not None and last.phase != "finished":
        await asyncio.to_thread(store.write, msgspec.structs.replace(last, phase="finished"))


async def _check_memory(board: BoardConnection, content: Content, project: Project) -> None:
    free = (await board.request(QueryMemorySizeRequest())).size
    more = content.growth(project)
    if more > free:
        raise ProjectError(
            f"the project takes {more:,} bytes more than what is on {board.url}, which has {free:,} free"
        )


async def _backup(
    board: BoardConnection,
    content: Content | None,
    begun: Journal | None,
    store: BackupStore,
    on_progress: ProgressCallback,
    *,
    wanted: bool,
) -> Path | None:
    """Return the backup with what was on the board before the import; none if there is none."""
    if begun is None:
        return await _keep(board, content or Content(), store, on_progress) if wanted else None
    if content is not None and not content.is_empty() and wanted:
        # It looks as if it had just been cleared, and not all of it is gone: or it is another board.
        path = await _keep(board, content, store, on_progress)
        logging.getLogger(__name__).warning("what is left on %s is kept in %s", escape(board.url), escape(str(path)))
    if begun.backup is None:
        return None
    path = store.kept(begun.backup)
    if path.is_file():
        return path
    logging.getLogger(__name__).warning("the backup of the import that goes on is gone: %s", escape(str(path)))
    return None


async def _keep(board: BoardConnection, content: Content, store: BackupStore, on_progress: ProgressCallback) -> Path:
    """Keep what is on the board; ProjectError if not all of it is given."""
    on_progress(Progress("saving", 0, 1, "backup"))
    try:
        old = content.project()
    except ProjectError as error:
        raise ProjectError(f"no backup of {board.url} can be made: {error}") from error
    path = await asyncio.to_thread(store.keep, old, board.url, board.codec.caption_encoding)
    on_progress(Progress("saving", 1, 1, "backup"))
    return path


async def roll_back(
    board: BoardConnection, backup: Path | None, *, store: BackupStore, on_progress: ProgressCallback
) -> ApplyResult:
    """Restore `backup`, by default the one of the unfinished import, else that of the last import at this address.

    ProjectError if there is none. It is an import like any other: it can be interrupted, and rolled back.
    """
    path = backup or await backup_for(board, store)
    project = await asyncio.to_thread(store.load, path, board.codec.caption_encoding)
    restores = path.name if path == store.kept(path.name) else None
    return await apply_project(board, project, store=store, on_progress=on_progress, unchecked=True, restores=restores)


async def backup_for(board: BoardConnection, store: BackupStore) -> Path:
    """Return the backup that holds what was on the board before the last import; ProjectError if there is none."""
    here, where = await read_project_id(board), board.url
    journals = await asyncio.to_thread(store.journals, here)
    journal = journal_of(journals, here, board.url) or last_import(journals, here, board.url)
    if journal is not None and journal.restores is not None and journal.phase != "finished":
        return store.kept(journal.restores)  # a rollback that was interrupted goes on
    if journal is None:
        what = (
            f"{where} holds an import that another computer began, or whose journal is lost"
            if is_unfinished(here)
            else f"no import from here is known that left {where} with project id {here}, so there is none to undo"
        )
        raise ProjectError(f"{what}; give `rollback` one of `servolink backups`, or apply a project")
    if journal.backup is None:
        raise ProjectError(f"the last import to {where} was made without a backup; apply a project")
    return store.kept(journal.backup)
