"""Back to what a board held before an import."""

from __future__ import annotations

import asyncio
from pathlib import Path

from servolink.errors import ProjectError
from servolink.printable import printable
from servolink.project.apply import Applied, apply_project
from servolink.project.file import load_project
from servolink.project.journal import is_unfinished, journal_of
from servolink.project.progress import Tell
from servolink.project.read import Asked, read_project_id
from servolink.project.store import Store


async def roll_back(board: Asked, backup: Path | None, *, store: Store, tell: Tell) -> Applied:
    """Restore `backup`, by default the one of the unfinished import, else the newest of this board's address.

    ProjectError if there is none. It is an import like any other: it can be interrupted, and rolled back.
    """
    path = backup or await backup_for(board, store)
    return await apply_project(board, load_project(path, exact=True), store=store, tell=tell, exact=True)


async def backup_for(board: Asked, store: Store) -> Path:
    """Return the backup that holds what was on the board before the last import; ProjectError if there is none."""
    here = await read_project_id(board)
    journal = journal_of(await asyncio.to_thread(store.journals), here, board.url)
    if journal is not None:
        if journal.backup is None:
            raise ProjectError(f"the import on {printable(board.url)} was begun without a backup; apply a project")
        return Path(journal.backup)
    if is_unfinished(here):
        raise ProjectError(
            f"{printable(board.url)} holds an import that another computer began, or whose journal is lost; choose "
            "one of `servolink backups`, or apply a project"
        )
    backups = await asyncio.to_thread(store.backups, board.url)
    if not backups:
        raise ProjectError(f"there is no backup of {printable(board.url)}; `servolink backups` lists all there are")
    return backups[-1].path
