"""Where a project comes from: a file, or a board."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from servolink.cli.main import OK, refuse
from servolink.project.files.file import load_project
from servolink.project.model import Project


def add_source(parser: argparse.ArgumentParser) -> None:
    """Add the argument."""
    parser.add_argument("source", metavar="FILE", help="a project file, or the address of a board, which is only read")


def is_address(source: str) -> bool:
    """Tell whether `source` is the address of a board."""
    return "://" in source


def with_project(args: argparse.Namespace, then: Callable[[Project], int]) -> int:
    """Read the project of `args.source` and return what `then` makes of it; a board is left as it is."""
    if not is_address(args.source):
        return then(load_project(Path(args.source), exact=True))

    if getattr(args, "in_place", False):
        refuse(args, "--in-place is for files; write into one with -o, and `servolink apply` writes it to a board")

    from servolink.cli.progress import shown_progress
    from servolink.cli.session import Interruption, converse
    from servolink.client.board import Board

    read: list[Project] = []

    async def talk(board: Board, interruption: Interruption) -> int:
        with shown_progress(board, quiet=args.json) as tell:
            read.append(await board.export_project(progress=tell))
        return OK

    args.url = args.source
    ended = converse(args, talk, state="the board was only read")
    return then(*read) if ended == OK else ended
