"""Whole projects: export, plan, import, rollback (document, 4.2 and 4.3)."""

from __future__ import annotations

import logging
from pathlib import Path

from servolink.client.read_back import ReadBack
from servolink.client.settings import Settings
from servolink.printable import printable
from servolink.project.imports.progress import Tell, tell_nobody
from servolink.project.imports.results import Applied, Plan
from servolink.project.model import Project


class Projects(Settings, ReadBack):
    """Everything stored on the board at once; `servolink.project` has what is done, and is loaded when it is used."""

    _told_of_import = False

    async def export_project(self, *, progress: Tell = tell_nobody) -> Project:
        """Return everything stored on the board, each part read until two consecutive readings agree (4.3).

        ProjectError if they never do, or if the board lists what it does not give.
        """
        from servolink.project.imports.connection import OneConnection
        from servolink.project.imports.read import read_project

        return await read_project(OneConnection(self), progress)

    async def plan(
        self, project: Project, *, replace: bool = False, exact: bool = False, progress: Tell = tell_nobody
    ) -> Plan:
        """Return what `apply` would change, and what that costs; changes nothing.

        `exact` is for a project that was read from a board and may hold what this library would not write by itself.
        """
        from servolink.project.imports.connection import OneConnection
        from servolink.project.imports.plan import plan_project

        return await plan_project(OneConnection(self), project, tell=progress, replace=replace, exact=exact)

    async def apply(
        self,
        project: Project,
        *,
        replace: bool = False,
        backup: bool = True,
        folder: Path | None = None,
        progress: Tell = tell_nobody,
    ) -> Applied:
        """Make the board hold `project`: only what differs is written, or with `replace` all of it (4.2).

        Before anything is changed the board's content is kept in `folder` (the user's data folder). Whatever
        interrupts it, a cancellation too, the next `apply` goes on, and `rollback` goes back. ProjectError for a
        project that cannot be written or does not fit, if no backup can be made, and if the board does not take it.
        """
        from servolink.project.imports.apply import apply_project
        from servolink.project.imports.connection import OneConnection
        from servolink.project.imports.store import Store

        board, store = OneConnection(self), Store(folder)
        return await apply_project(board, project, store=store, tell=progress, replace=replace, backup=backup)

    async def rollback(
        self, backup: Path | None = None, *, folder: Path | None = None, progress: Tell = tell_nobody
    ) -> Applied:
        """Make the board hold what it held before the last import at this address, or what `backup` holds.

        ProjectError if there is no such backup, or if the board is not as that import left it.
        """
        from servolink.project.imports.connection import OneConnection
        from servolink.project.imports.rollback import roll_back
        from servolink.project.imports.store import Store

        return await roll_back(OneConnection(self), backup, store=Store(folder), tell=progress)

    async def has_unfinished_import(self) -> bool:
        """Tell whether an import was begun on the board and not finished; `apply` again, or `rollback`."""
        from servolink.project.imports.journal import is_unfinished

        self._told_of_import = True
        return is_unfinished(await super().project_id())

    async def project_id(self) -> int:
        """Return the project id; 0 if the board has none (3.3.13).

        One that says that an import was begun and not finished is a warning in the log, once.
        """
        from servolink.project.imports.journal import is_unfinished

        project_id = await super().project_id()
        if is_unfinished(project_id) and not self._told_of_import:
            self._told_of_import = True
            logging.getLogger(__name__).warning(
                "%s holds an unfinished import: `apply` finishes it, `rollback` undoes it", printable(self.url)
            )
        return project_id
