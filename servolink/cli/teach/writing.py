"""Where a lesson goes: into a project file, or onto the board; nothing that was taught is lost."""

from __future__ import annotations

import re
from itertools import count
from pathlib import Path

from servolink.client.board import Board
from servolink.errors import ProjectError, ServolinkError
from servolink.printable import printable
from servolink.project.edits.lesson import Lesson, refuse_taken
from servolink.project.files.file import load_project, save_project
from servolink.project.model import Project
from servolink.protocol.editing import Action, Macro


async def check_name(board: Board, name: str, file: Path | None) -> None:
    """Raise ProjectError, before anything goes limp, if the lesson could not be written under `name`."""
    project = _in(file) if file is not None else await _outline(board)
    refuse_taken(project, name)
    Project.of(Action.pose(f"{name} 99", {}), Macro.of(name))


async def write(board: Board, lesson: Lesson, file: Path | None) -> str:
    """Add the lesson to the file, or to the board by an import; return where it is.

    If that fails it is written to a file of its own, and the error says which.
    """
    try:
        if file is not None:
            save_project(file, lesson.into(_in(file)))
            return str(file)
        await board.apply(lesson.into(await board.export_project()))
    except ServolinkError as error:
        kept = _free_file(lesson.caption)
        save_project(kept, lesson.into(Project()))
        where = printable(str(kept))
        raise ProjectError(f"{error}. What was taught is in {where}; `servolink project merge` adds it") from error
    return "on the board"


def _in(file: Path) -> Project:
    return load_project(file) if file.exists() else Project()


async def _outline(board: Board) -> Project:
    """Return the captions that are taken on the board."""
    actions = [Action(entry.action_id, entry.action_caption) for entry in await board.actions()]
    macros = [Macro(entry.macro_id, entry.macro_caption) for entry in await board.macros()]
    return Project(actions=tuple(actions), macros=tuple(macros))


def _free_file(caption: str) -> Path:
    """Return the name of a file in this folder that is not there yet."""
    name = re.sub(r"[^\w-]+", "_", caption).strip("_") or "lesson"
    names = (Path(f"{name}{f'-{number}' if number > 1 else ''}.servolink.json") for number in count(1))
    return next(path for path in names if not path.exists())
