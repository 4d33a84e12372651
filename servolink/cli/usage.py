"""Wrong usage that is found after the command line was parsed."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from servolink.escaping import escape
from servolink.script import USAGE

VARIABLES = ("SERVOLINK_BOARD", "SERVOLINK_URL")
"""Environment variables that name the board."""


def usage_error(args: argparse.Namespace, text: str) -> NoReturn:
    """End as wrong usage, with `text` after the usage of the command."""
    parser: argparse.ArgumentParser = args.parser
    parser.print_usage(sys.stderr)
    lines = "\n".join(map(escape, text.split("\n")))
    parser.exit(USAGE, f"{parser.prog}: error: {lines}\n")


def refuse_input(args: argparse.Namespace, source: Path, outputs: Iterable[Path]) -> None:
    """End as wrong usage if one of `outputs` is the file that is read, `source`, under whatever name."""
    for path in outputs:
        with suppress(OSError, ValueError):  # missing file
            if path.samefile(source):
                usage_error(
                    args, f"{path} is the file that is read, and would be lost; choose another name with --output"
                )


def refuse_board(args: argparse.Namespace, text: str) -> None:
    """End as wrong usage, with `text`, if a board was given to a command that takes none.

    The variables name the user's board for other commands, which says nothing about this one.
    """
    if named_board(args) is not None:
        usage_error(args, text)


def named_board(args: argparse.Namespace) -> str | None:
    """Return the board that the command line names; None if only a variable names one, or nothing does."""
    named: str | None = args.url
    return None if named in map(os.environ.get, VARIABLES) else named
