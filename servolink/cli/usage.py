"""Wrong usage, found while the command line is parsed or by a command."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from servolink.cli.screen.output import Form, print_error, print_json_error
from servolink.support import ExitCode

VARIABLES = ("SERVOLINK_BOARD", "SERVOLINK_URL")
"""Environment variables that name the board."""


class WrongUsage(SystemExit):
    """End of the process for wrong usage; `servolink.cli.main` prints the cause."""

    def __init__(self, parser: argparse.ArgumentParser, text: str) -> None:
        super().__init__(ExitCode.USAGE)
        self._parser = parser
        self._text = text

    def report(self) -> None:
        """Print usage and cause, or the cause as a JSON object for programs."""
        if Form.json:
            print_json_error("Usage", self._text)
            return
        text = f"{self._parser.format_usage()}{self._parser.prog}: error: {self._text}"
        for line in text.split("\n"):
            print_error(line)


def usage_error(args: argparse.Namespace, text: str) -> NoReturn:
    """End as wrong usage, with `text` after the usage of the command."""
    raise WrongUsage(args.parser, text)


def refuse_input(args: argparse.Namespace, source: Path, outputs: Iterable[Path]) -> None:
    """End as wrong usage if any of `outputs` is the input file `source`, under whatever name."""
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
    """Return the board named on the command line; None for a board named by a variable, or by nothing."""
    named: str | None = args.url
    return None if named in map(os.environ.get, VARIABLES) else named
