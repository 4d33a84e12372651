"""Projects (4): everything stored on a board at once. The code of transfers is imported on use."""

from __future__ import annotations

import logging
from pathlib import Path

from servolink.client.session import Session
from servolink.errors import escape, quote
from servolink.project import (
    UNFINISHED,
    ApplyResult,
    BackupStore,
    PinnedConnection,
    Plan,
    Progress,
    ProgressCallback,
    Project,
    apply_project,
    export_project,
    plan_project,
    roll_back,
)
from servolink.protocol import QueryActiveJoystickTableRequest, QueryProjectIDRequest


class ProjectTransfers:
    """Reads and writes everything stored on a board, each time over one connection, with the facts of the profile."""

    def __init__(self, session: Session) -> None:
        """Transfer through `session`."""
        self._session = session
        self._reported_unfinished = False

    async def export(self, on_progress: ProgressCallback | None) -> Project:
        """Return everything stored on the board (see `Board.export_project`)."""
        board = await self._pinned()
        async with self._session.transfer(""):
            return await export_project(board, on_progress or ignore_progress)

    async def plan(
        self, project: Project, *, replace: bool, unchecked: bool, on_progress: ProgressCallback | None
    ) -> Plan:
        """Return the changes of an `apply` (see `Board.plan_project`)."""
        check_project(project)
        board = await self._pinned()
        async with self._session.transfer("a project is being compared"):
            return await plan_project(
                board,
                project,
                on_progress=on_progress or ignore_progress,
                replace=replace,
                unchecked=unchecked,
            )

    async def apply(
        self,
        project: Project,
        *,
        replace: bool,
        backup: bool,
        folder: Path | None,
        unchecked: bool,
        on_progress: ProgressCallback | None,
    ) -> ApplyResult:
        """Make the board hold exactly `project` (see `Board.apply_project`)."""
        check_project(project)
        board, store = await self._pinned(), BackupStore(folder)
        async with self._session.transfer("a project is being written", moves=True):
            return await apply_project(
                board,
                project,
                store=store,
                on_progress=on_progress or ignore_progress,
                replace=replace,
                backup=backup,
                unchecked=unchecked,
            )

    async def roll_back(
        self, backup: Path | None, *, folder: Path | None, on_progress: ProgressCallback | None
    ) -> ApplyResult:
        """Write a backup to the board (see `Board.rollback_project`)."""
        board, store = await self._pinned(), BackupStore(folder)
        async with self._session.transfer("a backup is being restored", moves=True):
            return await roll_back(
                board,
                backup,
                store=store,
                on_progress=on_progress or ignore_progress,
            )

    async def has_unfinished_import(self, folder: Path | None) -> bool:
        """Return whether an import was interrupted (see `Board.has_unfinished_import`)."""
        self._reported_unfinished = True  # to the caller, so not to the log as well
        project_id = await self._session.find_project_id() or 0
        if project_id in UNFINISHED:
            return True
        store = BackupStore(folder)
        if not store.may_have_journals():
            return False

        return store.is_import_unfinished(project_id, self._session.connection.board_url)

    async def project_id(self) -> int:
        """Return the project id (3.3.13). At the first mark of an unfinished import, log a warning."""
        project_id = await self._session.project_id()
        if project_id in UNFINISHED and not self._reported_unfinished:
            self._reported_unfinished = True
            logging.getLogger(__name__).warning(
                "%s holds an unfinished import: apply the project again to finish it, or roll back to undo it",
                escape(self._session.url),
            )
        return project_id

    async def _pinned(self) -> PinnedConnection:
        """Return the board as a transfer needs it, which must know all that the board does not answer."""
        profile = self._session.profile
        # Openings leave short queries out by chance, and a plan must know all gaps before the first reading.
        for query in (QueryProjectIDRequest(), QueryActiveJoystickTableRequest()):
            if query not in self._session.connection.answered:
                await self._session.find(query)
        unanswered = self._session.unanswered
        if profile is None:
            return PinnedConnection(self._session, unanswered=unanswered)
        settings = profile.profile.settings
        return PinnedConnection(self._session, settings.memory_unit, settings.project_id_bits, unanswered)


def check_project(project: object) -> None:
    """Raise TypeError with the way to read a file, unless `project` is a Project."""
    if not isinstance(project, Project):
        raise TypeError(f"project must be a Project, not {quote(project)}; read a file with load_project(path)")


def ignore_progress(progress: Progress) -> None:
    """Callback that ignores all progress."""
