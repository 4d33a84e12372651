"""The `servolink` command: from the command line to an exit code, whatever happens in between."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Sequence

from servolink.cli.command_line import parser_of
from servolink.cli.screen.output import (
    fail,
    flush_stderr,
    flush_stdout,
    logged,
    lost_output,
    open_missing_stderr,
    print_error,
    silence,
)
from servolink.cli.usage import VARIABLES
from servolink.errors import ServolinkError
from servolink.script import FAILED, exit_code

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


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    args = parser_of().parse_args(argv)
    if args.url is None:
        args.url = next(filter(None, map(os.environ.get, VARIABLES)), None)
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
