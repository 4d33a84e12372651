"""`servolink export`: everything on a board into a project file."""

from __future__ import annotations

import argparse
from pathlib import Path

from servolink.cli.main import OK
from servolink.cli.output import print_json, print_text
from servolink.cli.progress import shown_progress
from servolink.cli.session import Interruption, converse
from servolink.client.board import Board
from servolink.errors import ProjectError
from servolink.printable import printable
from servolink.project.files.file import load_project, save_project


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink export`."""
    parser.add_argument("file", type=Path, metavar="FILE", help="such as robot.servolink.json")


def run(args: argparse.Namespace) -> int:
    """Read everything and write the file, whole or not at all."""
    _refuse_other_files(args.file)

    async def talk(board: Board, interruption: Interruption) -> int:
        with shown_progress(board, quiet=args.json) as tell:
            project = await board.export_project(progress=tell)
        save_project(args.file, project)
        interruption.state = f"{printable(str(args.file))} is written"
        counts = {name: len(getattr(project, name)) for name in _COUNTED}
        if args.json:
            print_json({"file": str(args.file), "project_id": project.project_id, **counts})
        else:
            counted = ", ".join(f"{count} {_words(name, count)}" for name, count in counts.items())
            print_text(f"{args.file}: project {project.project_id or 'without id'}, {counted}")
        return OK

    return converse(args, talk, state=f"{printable(str(args.file))} was not written")


_COUNTED = ("servo_parameters", "actions", "macros", "joystick_tables")


def _words(name: str, count: int) -> str:
    words = name.replace("_", " ")
    return words.removesuffix("s") if count == 1 else words


def _refuse_other_files(path: Path) -> None:
    """Raise ProjectError, before a board is read for nothing, rather than write over what is no project."""
    if not path.parent.is_dir():
        raise ProjectError(f"{printable(str(path.parent))} is no folder; make it, or take another name")
    if path.exists():
        try:
            load_project(path, exact=True)
        except ProjectError as error:
            raise ProjectError(
                f"{printable(str(path))} is there and is no project file, so it is not overwritten; take another name"
            ) from error
