"""The `servolink` command: from the command line to an exit code, whatever happens in between."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from servolink.cli.parser import build_parser
from servolink.cli.screen.output import (
    flush_stderr,
    flush_stdout,
    logged,
    lost_output,
    open_missing_stderr,
    print_error,
    silence,
)
from servolink.errors import ServolinkError
from servolink.escaping import escape
from servolink.script import FAILED, INTERRUPTED, NO_BOARD, OK, USAGE, exit_code

__all__ = [
    "FAILED",
    "INTERRUPTED",
    "NO_BOARD",
    "OK",
    "USAGE",
    "fail",
    "refuse_board",
    "refuse_input",
    "run",
    "usage_error",
]

_VARIABLES = ("SERVOLINK_BOARD", "SERVOLINK_URL")
_TRACEBACK = 2  # so many -v print the traceback of an error


def run(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (sys.argv without it) and return the exit code."""
    open_missing_stderr()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # captions may hold what this terminal cannot show
    verbosity = 0
    try:
        try:
            args = _parse(argv)
            verbosity = args.verbose
            with logged(verbosity):
                return int(args.run(args))
        finally:
            flush_stderr()
            flush_stdout()
    except BrokenPipeError:  # the reader of our output has gone, as in `| head`
        silence(1)
        return FAILED
    except Exception as error:
        if isinstance(error.__cause__, KeyboardInterrupt):
            raise
        if verbosity >= _TRACEBACK:
            _print_traceback()
        return fail(*_explained(error))


def fail(problem: Exception | str, code: int) -> int:
    """Print what went wrong and return `code`."""
    print_error(f"servolink: {problem}")
    return code


def usage_error(args: argparse.Namespace, text: str) -> NoReturn:
    """End as wrong usage, with `text` after the usage of the command."""
    parser: argparse.ArgumentParser = args.parser
    parser.print_usage(sys.stderr)
    lines = "\n".join(map(escape, text.split("\n")))
    parser.exit(USAGE, f"{parser.prog}: error: {lines}\n")


def refuse_input(args: argparse.Namespace, source: Path, outputs: Iterable[Path]) -> None:
    """End as wrong usage if one of `outputs` is the file that is read, `source`, under whatever name."""
    for path in outputs:
        with suppress(OSError, ValueError):  # there is no such file
            if path.samefile(source):
                usage_error(
                    args, f"{path} is the file that is read, and would be lost; choose another name with --output"
                )


def refuse_board(args: argparse.Namespace, text: str) -> None:
    """End as wrong usage, with `text`, if a board was given to a command that takes none.

    The variables name the user's board for other commands, which says nothing about this one.
    """
    if args.url not in {None, *map(os.environ.get, _VARIABLES)}:
        usage_error(args, text)


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    args: argparse.Namespace
    args, unknown = build_parser().parse_known_args(argv)
    if unknown:
        hint = getattr(args, "alternative", "")  # what some commands say to those who want a part of what they do
        usage_error(args, f"unexpected argument: {unknown[0]}{hint}")
    if args.url is None:
        args.url = next(filter(None, map(os.environ.get, _VARIABLES)), None)
    return args


def _explained(error: Exception) -> tuple[Exception | str, int]:
    """Return what to say about an error, and the exit code."""
    if isinstance(error, ServolinkError):
        return error, exit_code(error)
    if isinstance(error, OSError):
        return lost_output(error) or error, FAILED
    name = type(error).__name__
    return f"internal error, please report it with the output of the same command and -vv: {name}: {error}", FAILED


def _print_traceback() -> None:
    import traceback

    for line in traceback.format_exc().splitlines():
        print_error(line)
