"""The `servolink` command: from the command line to an exit code, whatever happens in between."""

from __future__ import annotations

import argparse
import io
import os
import sys
import traceback
from collections.abc import Sequence
from itertools import takewhile

from servolink.cli.command_line import parser_of
from servolink.cli.screen.output import (
    SPOKEN,
    Form,
    fail,
    flush_stderr,
    flush_stdout,
    logged,
    lost_output,
    open_missing_stderr,
    print_error,
    silence,
)
from servolink.cli.screen.result import ended
from servolink.cli.usage import VARIABLES, WrongUsage
from servolink.errors import ServolinkError
from servolink.support import ExitCode

_TRACEBACK = 2  # so many -v print the traceback of an error


def run(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (sys.argv without it) and return the exit code."""
    open_missing_stderr()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=SPOKEN)
    Form.json = "--json" in takewhile(lambda word: word != "--", sys.argv[1:] if argv is None else argv)
    try:
        return _run(argv)
    finally:
        Form.json = False


def _run(argv: Sequence[str] | None) -> int:
    verbosity = 0
    try:
        try:
            args = _parse(argv)
            verbosity, Form.json = args.verbose, args.json
            with logged(verbosity):
                return ended(args.run(args))
        finally:
            flush_stderr()
            flush_stdout()
    except WrongUsage as wrong:
        wrong.report()
        raise
    except BrokenPipeError:  # the reader of our output has gone, as in `| head`
        silence(1)
        return ExitCode.FAILED
    except Exception as error:
        if isinstance(error.__cause__, KeyboardInterrupt):
            raise
        if verbosity >= _TRACEBACK:
            _print_traceback()
        return _fail(error)


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line, with the board of the environment as default."""
    args = parser_of().parse_args(argv)
    if args.url is None:
        args.url = next(filter(None, map(os.environ.get, VARIABLES)), None)
    return args


def _fail(error: Exception) -> int:
    """Print the error that ended a command, and return the exit code."""
    if isinstance(error, ServolinkError):
        return fail(error, ExitCode.of(error))
    if isinstance(error, OSError):
        return fail(error, ExitCode.FAILED, text=lost_output(error))
    name = type(error).__name__
    text = f"internal error, please report it with the output of the same command and -vv: {name}: {error}"
    return fail(error, ExitCode.FAILED, kind="InternalError", text=text)


def _print_traceback() -> None:
    for line in traceback.format_exc().splitlines():
        print_error(line)
