"""Back to what a board held before an import."""

from __future__ import annotations

import asyncio
from pathlib import Path

from servolink.errors import ProjectError
from servolink.printable import printable
from servolink.project.imports.apply import apply_project
from servolink.project.imports.journal import is_unfinished, journal_of, last_import
from servolink.project.imports.progress import Tell
from servolink.project.imports.read import Asked, read_project_id
from servolink.project.imports.results import Applied
from servolink.project.imports.store import Store


async def roll_back(board: Asked, backup: Path | None, *, store: Store, tell: Tell) -> Applied:
    """Restore `backup`, by default the one of the unfinished import, else that of the last import at this address.

    ProjectError if there is none. It is an import like any other: it can be interrupted, and rolled back.
    """
    path = backup or await backup_for(board, store)
    project = await asyncio.to_thread(store.load, path, board.codec.caption_encoding)
    restores = path.name if path == store.kept(path.name) else None
    return await apply_project(board, project, store=store, tell=tell, exact=True, restores=restores)


async def backup_for(board: Asked, store: Store) -> Path:
    """Return the backup that holds what was on the board before the last import; ProjectError if there is none."""
    here, where = await read_project_id(board), printable(board.url)
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
