"""Read the project of a command from a file or a board, and write what the command made of it."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from servolink.cli.main import OK, usage_error
from servolink.cli.output import print_json, print_text
from servolink.errors import ProjectError
from servolink.project.figure import Figure
from servolink.project.model import Project
from servolink.project.project_file import load_project, read_project_file, save_project
from servolink.project.validate import validate_project


def add_source(parser: argparse.ArgumentParser) -> None:
    """Add the argument FILE."""
    parser.add_argument("source", metavar="FILE", help="a project file, or the address of a board, which is only read")


def is_address(source: str) -> bool:
    """Return whether `source` is the address of a board."""
    return "://" in source


def with_project(args: argparse.Namespace, then: Callable[[Project], int]) -> int:
    """Read the project of `args.source` and return the exit code of `then`. A board is only read."""
    if not is_address(args.source):
        return then(load_project(Path(args.source), unchecked=True))

    if getattr(args, "in_place", False):
        usage_error(args, "--in-place is for files; write a file with -o, and `servolink apply` writes it to a board")

    from servolink.cli.live import shown_progress
    from servolink.cli.session import Interruption, run_with_board
    from servolink.client.board import Board

    read: list[Project] = []

    async def talk(board: Board, interruption: Interruption) -> int:
        with shown_progress(board, quiet=args.json) as on_progress:
            read.append(await board.export_project(on_progress=on_progress))
        return OK

    args.url = args.source
    ended = run_with_board(args, talk, state="the board was only read")
    return then(*read) if ended == OK else ended


def add_output(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where to write the result."""
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("-o", "--output", type=Path, metavar="OUT", help="write the result to this file")
    where.add_argument("--in-place", action="store_true", help="write the result to FILE itself")
    add_force(parser)


def add_force(parser: argparse.ArgumentParser) -> None:
    """Add the option that allows replacing files."""
    parser.add_argument("--force", action="store_true", help="replace an existing file")


def write_edited(args: argparse.Namespace, before: Project, after: Project, changes: list[str], **more: Any) -> int:
    """Write `after` where `args` says, whole or not at all, and print the changes.

    Raise ProjectError, and write nothing, if a board could not store it.
    """
    target: Path = Path(args.source) if args.in_place else args.output
    is_new = not args.in_place or after != before
    if is_new:
        figure = None if is_address(args.source) else read_project_file(args.source, unchecked=True).figure
        write_new(args, target, after, figure)
    if args.json:
        print_json({"file": str(target), "written": is_new, "changes": changes, **more})
        return OK
    for change in changes:
        print_text(change)
    print_text(f"{target}: {'written' if is_new else 'nothing to change'}")
    return OK


def write_new(args: argparse.Namespace, target: Path, project: Project, figure: Figure | None = None) -> None:
    """Write `project` to a file that does not exist yet, or that `args` allows to replace.

    Raise ProjectError if no board could store it, with captions in the encoding of `args`.
    """
    found = validate_project(project, caption_encoding=args.caption_encoding or "utf-8")
    if errors := [str(problem) for problem in found if problem.severity == "error"]:
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        raise ProjectError(f"nothing was written, because a board could not store the result: {errors[0]}{more}")
    if target.exists() and not (args.force or getattr(args, "in_place", False)):
        raise ProjectError(f"{target}: exists already; --force replaces it")
    save_project(target, project, figure=figure)
