"""Read the project of a command from a file or a board, and write the changed project."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from msgspec import UNSET, UnsetType

from servolink.cli.arguments import new_file, not_empty
from servolink.cli.command import flag, one_of, option
from servolink.cli.command_session import Interruption, run_with_board
from servolink.cli.screen.live import shown_progress
from servolink.cli.screen.result import CommandResult, Ending, Returned
from servolink.cli.usage import usage_error
from servolink.client import Board
from servolink.errors import ProjectError
from servolink.project import Project, ProjectFile, load_project, refuse_new_errors, save_project, validate_project
from servolink.support import ExitCode, reason, write_atomically

SOURCE = (option("source", "FILE", "a project file, or the address of a board, which is only read", not_empty),)


class ProjectEdited(CommandResult, frozen=True, kw_only=True):
    """JSON of `project scale-time`, `project merge`, `project rename`, `project mirror` and `twin soften`.

    `pairs` are the servos exchanged by `project mirror`, `unsolved` the macros left unchanged by `twin soften`.
    """

    file: str | None
    written: bool
    changes: Sequence[str]
    pairs: list[tuple[int, int]] | UnsetType = UNSET
    unsolved: list[int] | UnsetType = UNSET


def is_address(source: str) -> bool:
    """Return whether `source` is the address of a board."""
    return "://" in source


def with_project(args: argparse.Namespace, then: Callable[[Project], Ending]) -> Ending:
    """Read the project of `args.source` and return what `then` returns. A board is only read."""
    if not is_address(args.source):
        return then(load_project(Path(args.source), unchecked=True))

    if getattr(args, "in_place", False):
        usage_error(args, "--in-place is for files; write a file with -o, and `servolink apply` writes it to a board")

    read: list[Project] = []

    async def talk(board: Board, interruption: Interruption) -> int:
        with shown_progress(board) as on_progress:
            read.append(await board.export_project(on_progress=on_progress))
        return ExitCode.OK

    args.url = args.source
    code = run_with_board(args, talk, state="the board was only read")
    return then(*read) if code == ExitCode.OK else code


FORCE = (flag("--force", "replace an existing file"),)


OUTPUT = (
    one_of(
        option("-o --output", "OUT", "write the result to this file", new_file),
        flag("--in-place", "write the result to FILE itself"),
        required=True,
    ),
    *FORCE,
)


def write_edited(
    args: argparse.Namespace, before: Project, after: Project, changes: Sequence[str], **more: Any
) -> Returned:
    """Write `after` to the file of `args`, whole or not at all, and print the changes.

    Raise ProjectError, and write nothing, if a board could not store it. An export of values that servolink would not
    write unasked stays one; no others may be added to it.
    """
    target: Path = Path(args.source) if args.in_place else args.output
    is_new = not args.in_place or after != before
    if is_new:
        file = _edited(args, before)
        if file.unchecked:
            _refuse_new_errors(args, before, after)
        else:
            _refuse_errors(args, after)
        _write(args, target, after, file)
    edited = ProjectEdited(file=str(target), written=is_new, changes=changes, **more)
    return Returned(edited, [*changes, f"{target}: {'written' if is_new else 'nothing to change'}"])


def write_new(args: argparse.Namespace, target: Path, file: ProjectFile) -> None:
    """Write a new file, or replace an existing file if `args` allow it.

    Raise ProjectError if no board could store it, with captions in the encoding of `args`.
    """
    _refuse_errors(args, file.project)
    _write(args, target, file.project, file)


def write_bytes(args: argparse.Namespace, target: Path, content: bytes) -> None:
    """Write a file. Raise ProjectError for an existing one without `--force`."""
    _refuse_existing(args, target)
    try:
        write_atomically(target, content)
    except OSError as error:
        raise ProjectError(f"{target}: cannot be written: {reason(error)}") from error


def _edited(args: argparse.Namespace, before: Project) -> ProjectFile:
    """Return the file being edited; for the project of a board, the file of an export."""
    if is_address(args.source):
        return ProjectFile(before, unchecked=bool(_errors(args, before)))
    return ProjectFile.read(args.source, unchecked=True)


def _errors(args: argparse.Namespace, project: Project) -> list[str]:
    """Return the errors of a project as sentences, without warnings."""
    found = validate_project(project, caption_encoding=args.caption_encoding or "utf-8")
    return [str(one) for one in found if one.severity == "error"]


def _refuse_new_errors(args: argparse.Namespace, before: Project, after: Project) -> None:
    """Raise ProjectError for errors absent before the change."""
    try:
        refuse_new_errors(before, after, args.caption_encoding or "utf-8")
    except ProjectError as error:
        raise ProjectError(f"nothing was written, because the result would have a new error: {error}") from error


def _refuse_errors(args: argparse.Namespace, project: Project) -> None:
    """Raise ProjectError for a project with errors."""
    if errors := _errors(args, project):
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        raise ProjectError(f"nothing was written, because a board could not store the result: {errors[0]}{more}")


def _write(args: argparse.Namespace, target: Path, project: Project, like: ProjectFile) -> None:
    """Write `project` with the mark, the figure and the blocks of the file `like`."""
    _refuse_existing(args, target)
    save_project(target, project, unchecked=like.unchecked, figure=like.figure, blocks=like.blocks)


def _refuse_existing(args: argparse.Namespace, target: Path) -> None:
    if target.exists() and not (args.force or getattr(args, "in_place", False)):
        raise ProjectError(f"{target}: exists already; --force replaces it")
