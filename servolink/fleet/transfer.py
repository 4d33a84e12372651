"""A project onto many boards, and the content of many boards into files."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from servolink.errors import EncodeError, ProjectError, ServolinkError
from servolink.fleet.controller import Controller
from servolink.fleet.each import Outcomes, for_each
from servolink.fleet.exchange import OnStep
from servolink.fleet.topics import Step
from servolink.hub.control.messages import Applied
from servolink.project.model import Project
from servolink.project.project_file import file_type, project_from_form, project_to_form, save_project
from servolink.protocol.json_errors import convert

T = TypeVar("T")

PARALLEL = 8
"""Boards that are read or written at the same time."""
PATIENCE = 30.0
"""Seconds without a step after which a board counts as silent."""

OnBoardStep = Callable[[str, Step], None]
"""Called with each step of each board."""
OnOutcome = Callable[[str, ServolinkError | None], None]
"""Called with each board that is done, and the error if it failed."""


class BoardPlan(Struct, frozen=True):
    """What an import would do to one board."""

    what: tuple[str, ...]
    """What would change, such as `action 3`."""
    deleted: tuple[str, ...]
    """The records among them that would be deleted."""
    inconsistencies: tuple[str, ...]
    """Faults that the import repairs too."""
    seconds: float
    """How long it takes, about."""
    warning: str | None
    """Why the project may not fit."""
    is_unfinished: bool
    """The board holds an unfinished import, which this one continues or replaces."""

    @property
    def differs(self) -> bool:
        """Whether there is anything to do."""
        return bool(self.what or self.inconsistencies or self.is_unfinished)


def ignore_step(board: str, step: Step) -> None:
    """Ignore a step."""


def ignore_outcome(board: str, error: ServolinkError | None) -> None:
    """Ignore an outcome."""


async def plan_each(
    controller: Controller,
    boards: Iterable[str],
    project: Project,
    *,
    replace: bool = False,
    unchecked: bool = False,
    parallel: int = PARALLEL,
    on_step: OnBoardStep = ignore_step,
    on_outcome: OnOutcome = ignore_outcome,
) -> Outcomes[BoardPlan]:
    """Ask each board what `apply_each` would change. Nothing is changed."""
    params = {"project": project_to_form(project, unchecked=unchecked), "replace": replace}

    async def plan(board: str) -> BoardPlan:
        found = await controller.call(board, "project.plan", params, patience=PATIENCE, on_step=_steps(board, on_step))
        return _plan(board, found)

    return await for_each(boards, plan, parallel=parallel, on_outcome=on_outcome)


async def apply_each(
    controller: Controller,
    boards: Iterable[str],
    project: Project,
    *,
    replace: bool = False,
    unchecked: bool = False,
    backup: bool = True,
    parallel: int = PARALLEL,
    fail_fast: bool = False,
    on_step: OnBoardStep = ignore_step,
    on_outcome: OnOutcome = ignore_outcome,
) -> Outcomes[Applied]:
    """Make each board hold the project. To be called again after a failure: what is done is not done again."""
    params = {"project": project_to_form(project, unchecked=unchecked), "replace": replace, "backup": backup}

    async def apply(board: str) -> Applied:
        found = await controller.call(board, "project.apply", params, patience=PATIENCE, on_step=_steps(board, on_step))
        return _converted(board, found, Applied)

    return await for_each(boards, apply, parallel=parallel, fail_fast=fail_fast, on_outcome=on_outcome)


async def export_each(
    controller: Controller,
    boards: Iterable[str],
    folder: Path,
    *,
    parallel: int = PARALLEL,
    on_step: OnBoardStep = ignore_step,
    on_outcome: OnOutcome = ignore_outcome,
) -> Outcomes[Path]:
    """Write the content of each board to a project file of its name in `folder`, which must exist."""

    async def export(board: str) -> Path:
        found = await controller.call(board, "project.export", patience=PATIENCE, on_step=_steps(board, on_step))
        project, unchecked = _project(board, found)
        path = export_path(folder, board)
        await asyncio.to_thread(save_project, path, project, unchecked=unchecked)
        return path

    return await for_each(boards, export, parallel=parallel, on_outcome=on_outcome)


def export_path(folder: Path, board: str) -> Path:
    """Return the file for the content of a board."""
    return folder / f"{board}.servolink.json"


def _steps(board: str, on_step: OnBoardStep) -> OnStep:
    return lambda step: on_step(board, step)


def _plan(board: str, found: Any) -> BoardPlan:
    """Return the plan of a board. Records are kept there: with hundreds of boards they take more than is shown."""
    planned = _converted(board, found, _Planned)
    changes = planned.changes
    return BoardPlan(
        tuple(change.what for change in changes),
        tuple(change.what for change in changes if change.new is None and not isinstance(change.old, int)),
        planned.inconsistencies,
        planned.estimated_seconds,
        None if planned.memory is None else planned.memory.warning,
        planned.is_unfinished,
    )


class _Change(Struct):
    what: str
    old: Any = None
    new: Any = None


class _Memory(Struct):
    warning: str | None = None


class _Planned(Struct):
    """What is used of the result of `project.plan`."""

    changes: tuple[_Change, ...]
    inconsistencies: tuple[str, ...]
    estimated_seconds: float
    is_unfinished: bool
    memory: _Memory | None = None


def _converted(board: str, found: Any, kind: type[T]) -> T:
    try:
        return msgspec.convert(found, kind)
    except msgspec.ValidationError as error:
        raise ServolinkError(f"{board} answers what this version of servolink cannot read: {error}") from error


def _project(board: str, found: Any) -> tuple[Project, bool]:
    """Return the project in an export, and whether it holds values that servolink would not write unasked."""
    try:
        content = project_from_form(convert(found["project"], file_type(unchecked=True)))
    except (EncodeError, KeyError, TypeError) as error:
        raise ProjectError(f"{board} sends a project that cannot be read: {error}") from error
    return content.project, content.unchecked
