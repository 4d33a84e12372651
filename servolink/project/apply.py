"""A project onto a board: what is settled before the first byte is written, and when all of it is done."""

from __future__ import annotations

import asyncio
from pathlib import Path

from msgspec import Struct

from servolink.errors import EncodeError, ProjectError
from servolink.printable import printable
from servolink.project.check import problems
from servolink.project.importing import Import
from servolink.project.journal import Journal, JournalPhase, free_marker, is_unfinished, journal_of
from servolink.project.model import Project
from servolink.project.progress import Progress, Tell
from servolink.project.read import Asked, Content, read_content, read_project_id
from servolink.project.size import total_size
from servolink.project.store import Store, digest_of
from servolink.project.writes import writes
from servolink.protocol.settings import QueryMemorySizeRequest


class Applied(Struct, frozen=True):
    """What an import did."""

    changed: bool
    """False: the board held the project already, and nothing was written."""
    resumed: bool
    """It went on with an import that had been interrupted."""
    backup: Path | None
    """What the board held before."""


async def apply_project(
    board: Asked,
    project: Project,
    *,
    store: Store,
    tell: Tell,
    replace: bool = False,
    backup: bool = True,
    exact: bool = False,
) -> Applied:
    """Make the board hold `project`.

    `replace` deletes everything first (document, 4.2), otherwise only what differs is written. `backup=False` goes on
    without a backup. `exact` writes what was read from a board, however odd. ProjectError, before anything is
    changed, for a project that cannot be written or does not fit, and if no backup can be made; later, if the board
    does not take it. After any error from `marking` on, and after a cancellation, the next call goes on.
    """
    check_writable(board, project, exact=exact)
    journals = await asyncio.to_thread(store.journals)
    here = await read_project_id(board)
    journal = journal_of(journals, here, board.url)
    resumed, content = journal is not None, None
    if journal is None or not is_unfinished(here):
        content = await read_content(board, tell)
    if journal is None:
        assert content is not None  # noqa: S101 - narrows the type; it was read two lines before
        if not writes(content, project) and content.project_id == project.project_id:
            return Applied(changed=False, resumed=False, backup=None)
        await _check_memory(board, content, project)
        kept = await _keep(board, content, store, tell) if backup else None
        digest = digest_of(project)
        marker = free_marker(journals, int(digest, 16))
        phase: JournalPhase = "clearing" if replace else "writing"
        journal = Journal(marker, board.url, digest, None if kept is None else str(kept), phase)
    elif content is not None and any(content.records.values()) and backup:
        # It looks as if it had just been cleared, but somebody may have stored something new since.
        await _keep(board, content, store, tell)
    await Import(board, project.sorted(), journal, store, tell, exact=exact).run(content, replace=replace)
    stale = [one for one in journals if one.url == board.url and one.phase == "clearing"]
    for one in (*stale, journal):
        await asyncio.to_thread(store.end, one)
    tell(Progress("finishing", 1, 1, f"project id {project.project_id}"))
    return Applied(changed=True, resumed=resumed, backup=Path(journal.backup) if journal.backup else None)


def check_writable(board: Asked, project: Project, *, exact: bool) -> None:
    """Raise ProjectError for what cannot be written to any board; `exact` as in `apply_project`."""
    if not exact:
        for problem in problems(project, caption_encoding=board.codec.caption_encoding):
            if problem.severity == "error":
                raise ProjectError(str(problem))
    for write in writes(Content(), project):
        try:
            board.codec.encode(write.request, exact=exact)
        except EncodeError as error:
            raise ProjectError(f"{write.item} cannot be written to a board: {error}") from error


async def _check_memory(board: Asked, content: Content, project: Project) -> None:
    free = (await board.request(QueryMemorySizeRequest())).size
    more = total_size(project) - total_size(content.readable())
    if more > free:
        raise ProjectError(
            f"the project takes {more:,} bytes more than what is on {printable(board.url)}, which has {free:,} free"
        )


async def _keep(board: Asked, content: Content, store: Store, tell: Tell) -> Path:
    """Keep what is on the board; ProjectError if it could not be written back."""
    tell(Progress("saving", 0, 1, "backup"))
    try:
        old = content.project()
        check_writable(board, old, exact=True)
    except ProjectError as error:
        raise ProjectError(f"no backup of {printable(board.url)} can be made: {error}") from error
    try:
        path = await asyncio.to_thread(store.keep, old, board.url)
    except OSError as error:
        raise ProjectError(f"the backup cannot be written: {printable(str(error))}") from error
    tell(Progress("saving", 1, 1, "backup"))
    return path
