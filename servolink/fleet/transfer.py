"""A project onto many boards, and the content of many boards into files."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from msgspec import Struct

from servolink.control import Applied
from servolink.errors import EncodeError, ProjectError, ServolinkError
from servolink.fleet.controller import Controller
from servolink.fleet.each import Outcomes, Work, for_each
from servolink.fleet.pending_command import result_as
from servolink.fleet.topics import TransferStep
from servolink.project import Project, ProjectFile, save_project
from servolink.protocol import convert

T = TypeVar("T")

PARALLEL = 8
"""Boards that are read or written at the same time."""
PATIENCE = 30.0
"""Seconds without a step after which a board counts as silent."""

OnBoardStep = Callable[[str, TransferStep], None]
"""Called with each step of each board."""
OnOutcome = Callable[[str, ServolinkError | None], None]
"""Called with each finished board, and the error of a failure."""


class BoardPlan(Struct, frozen=True):
    """Plan of an import for a board."""

    what: tuple[str, ...]
    """Changes by the import, such as `action 3`."""
    deleted: tuple[str, ...]
    """Records deleted by the import."""
    inconsistencies: tuple[str, ...]
    """Faults that the import repairs too."""
    seconds: float
    """Estimated duration of the import."""
    warning: str | None
    """Why the project may not fit."""
    is_unfinished: bool
    """Whether the board holds an unfinished import, to be continued or replaced."""

    @property
    def differs(self) -> bool:
        """Whether the import has any work to do."""
        return bool(self.what or self.inconsistencies or self.is_unfinished)


def ignore_step(board: str, step: TransferStep) -> None:
    """Ignore a step."""


def ignore_outcome(board: str, error: ServolinkError | None) -> None:
    """Ignore an outcome."""


class Transfer:
    """Work on several boards, a few at a time."""

    def __init__(
        self,
        controller: Controller,
        boards: Iterable[str],
        *,
        parallel: int = PARALLEL,
        fail_fast: bool = False,
        on_step: OnBoardStep = ignore_step,
        on_outcome: OnOutcome = ignore_outcome,
    ) -> None:
        """Work on `parallel` of `boards` at a time; with `fail_fast`, begin no further board after a failure."""
        self._controller = controller
        self._boards = boards
        self._parallel = parallel
        self._fail_fast = fail_fast
        self._on_step = on_step
        self._on_outcome = on_outcome

    @staticmethod
    def export_path(folder: Path, board: str) -> Path:
        """Return the file for the content of a board."""
        return folder / f"{board}.servolink.json"

    async def plan(self, project: Project, *, replace: bool = False, unchecked: bool = False) -> Outcomes[BoardPlan]:
        """Ask each board what `apply` would change. Nothing is changed."""
        params = {"project": ProjectFile(project, unchecked=unchecked).form(), "replace": replace}

        async def plan(board: str) -> BoardPlan:
            return _plan(board, await self._ask(board, "project.plan", params))

        return await self._each(plan)

    async def apply(
        self, project: Project, *, replace: bool = False, unchecked: bool = False, backup: bool = True
    ) -> Outcomes[Applied]:
        """Make each board hold the project. Call again after a failure: finished work is not repeated."""
        params = {"project": ProjectFile(project, unchecked=unchecked).form(), "replace": replace, "backup": backup}

        async def apply(board: str) -> Applied:
            return result_as(board, await self._ask(board, "project.apply", params), Applied)

        return await self._each(apply)

    async def export(self, folder: Path) -> Outcomes[Path]:
        """Write the content of each board to a project file named after the board in `folder`, which must exist."""

        async def export(board: str) -> Path:
            project, unchecked = _project(board, await self._ask(board, "project.export", {}))
            path = self.export_path(folder, board)
            await asyncio.to_thread(save_project, path, project, unchecked=unchecked)
            return path

        return await self._each(export)

    async def _ask(self, board: str, method: str, params: Mapping[str, Any]) -> Any:
        def on_step(step: TransferStep) -> None:
            self._on_step(board, step)

        return await self._controller.call(board, method, params, patience=PATIENCE, on_step=on_step)

    async def _each(self, work: Work[T]) -> Outcomes[T]:
        return await for_each(
            self._boards, work, parallel=self._parallel, fail_fast=self._fail_fast, on_outcome=self._on_outcome
        )


def _plan(board: str, found: Any) -> BoardPlan:
    """Return the plan of a board, without records: for hundreds of boards, those need much memory."""
    planned = result_as(board, found, _BoardPlanned)
    changes = planned.changes
    return BoardPlan(
        tuple(change.what for change in changes),
        tuple(change.what for change in changes if change.new is None and not isinstance(change.old, int)),
        planned.inconsistencies,
        planned.estimated_seconds,
        None if planned.memory is None else planned.memory.warning,
        planned.is_unfinished,
    )


class _ChangeSent(Struct):
    what: str
    old: Any = None
    new: Any = None


class _MemoryAfter(Struct):
    warning: str | None = None


class _BoardPlanned(Struct):
    """Fields used from the result of `project.plan`."""

    changes: tuple[_ChangeSent, ...]
    inconsistencies: tuple[str, ...]
    estimated_seconds: float
    is_unfinished: bool
    memory: _MemoryAfter | None = None


def _project(board: str, found: Any) -> tuple[Project, bool]:
    """Return the project in an export, and whether any value is outside the range that servolink writes unasked."""
    try:
        content = ProjectFile.of_form(convert(found["project"], ProjectFile.form_type(unchecked=True)))
    except (EncodeError, KeyError, TypeError) as error:
        raise ProjectError(f"{board} sends a project that cannot be read: {error}") from error
    return content.project, content.unchecked
