"""The `servolink` command: its options, its commands, its exit codes."""

from __future__ import annotations

import argparse
import importlib
import io
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from servolink.cli.arguments import caption_encoding, not_empty
from servolink.cli.output import flush_stdout, lost_output, open_missing_stderr, print_error, silence
from servolink.errors import ServolinkError, TransportError
from servolink.escaping import escape

OK, FAILED, USAGE, NO_BOARD, INTERRUPTED = 0, 1, 2, 3, 130

COMMANDS = {
    "demo": ("servolink.cli.demo", "show all of it on a virtual board, in about 10 seconds"),
    "list": ("servolink.cli.boards:list", "list the boards that are here"),
    "use": ("servolink.cli.boards:use", "give a board a name, for --url and in programs"),
    "doctor": ("servolink.cli.doctor", "find out why a board does not work"),
    "info": ("servolink.cli.boards:info", "project id, memory, battery and what is stored on the board"),
    "servos": ("servolink.cli.servos", "angle, current and temperature of each servo"),
    "move": ("servolink.cli.motion:move", "move servos to angles"),
    "stop": ("servolink.cli.motion:stop", "stop all servos and keep holding them"),
    "release": ("servolink.cli.motion:stop", "let servos go limp"),
    "run": ("servolink.cli.motion:stored", "run an action or a macro stored on the board"),
    "actions": ("servolink.cli.records", "list the actions stored on the board, or show one"),
    "macros": ("servolink.cli.records", "list the macros stored on the board, or show one"),
    "tables": ("servolink.cli.records", "list the joystick tables stored on the board, or show one"),
    "export": ("servolink.cli.export:export", "write everything on the board into a project file"),
    "plan": ("servolink.cli.plan", "show what a project file would change on the board"),
    "apply": ("servolink.cli.apply", "write a project file to the board, without ever losing what was there"),
    "rollback": ("servolink.cli.apply", "bring back what was on the board before the last import"),
    "project": ("servolink.cli.project", "show, check, edit and play projects in files, without a board"),
    "teach": ("servolink.cli.teach", "take poses of limbs that are moved by hand"),
    "backups": ("servolink.cli.export:backups", "list what was on boards before imports"),
    "events": ("servolink.cli.events", "show button events as they come"),
    "decode": ("servolink.cli.packets", "turn frames into readable packets"),
    "encode": ("servolink.cli.packets", "turn packets into frames"),
    "virtual": ("servolink.cli.virtual", "serve a virtual board over a pseudo-terminal or TCP"),
    "bench": ("servolink.cli.bench", "measure round trips to the board"),
}
"""Command name to its module and help.

A module has `configure(command, parser)`, which adds the options, and `run(args)`, which returns the exit code. Behind
a colon stands the suffix of these two names, where one module has several commands: `boards:use` has `configure_use`.
"""

EXIT_CODES = "exit codes: 0 ok, 1 failed, 2 wrong usage, 3 no board, 130 interrupted"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (sys.argv without it) and return the exit code."""
    open_missing_stderr()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # captions may hold what this terminal cannot show
    try:
        try:
            args = _parser().parse_args(argv)
            return int(command_function(COMMANDS[args.command][0], "run")(args))
        finally:
            flush_stdout()
    except KeyboardInterrupt:
        return INTERRUPTED
    except RuntimeError as error:  # Python before 3.12 wraps what comes while a class is made, as modules are loaded
        if isinstance(error.__cause__, KeyboardInterrupt):
            return INTERRUPTED
        raise
    except BrokenPipeError:  # the reader of our output has gone, as in `| head`
        silence(1)
        return FAILED
    except TransportError as error:
        return fail(error, NO_BOARD)
    except ServolinkError as error:
        return fail(error, FAILED)
    except OSError as error:
        return fail(lost_output(error) or error, FAILED)


def command_function(place: str, name: str) -> Callable[..., Any]:
    """Return `configure` or `run` of the command at `place`, in the form of COMMANDS."""
    module, _, suffix = place.partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), f"{name}_{suffix}" if suffix else name)
    return found


def fail(problem: Exception | str, code: int) -> int:
    """Say what went wrong and return `code`."""
    print_error(f"servolink: {escape(str(problem))}")
    return code


def refuse(args: argparse.Namespace, text: str) -> NoReturn:
    """End as wrong usage, with `text` after the usage of the command."""
    parser: argparse.ArgumentParser = args.parser
    parser.print_usage(sys.stderr)
    lines = "\n".join(map(escape, text.split("\n")))
    parser.exit(USAGE, f"{parser.prog}: error: {lines}\n")


class _Parser(argparse.ArgumentParser):
    """Repeats what was typed so that it can be shown."""

    def error(self, message: str) -> NoReturn:
        """End as wrong usage."""
        super().error(escape(message))

    def print_help(self, file: Any = None) -> None:
        """Print the help, or fail; that of argparse says nothing when it cannot."""
        print(self.format_help(), file=file, end="", flush=True)


class _Command(_Parser):
    """Takes its options from the module of its command, which is imported only when that command is given."""

    module = ""

    def parse_known_args(  # pyright: ignore[reportIncompatibleMethodOverride] - it is overloaded
        self, args: Any = None, namespace: Any = None
    ) -> Any:
        """Parse, with the options of the module."""
        if self.module:
            module, self.module = self.module, ""
            command_function(module, "configure")(self.prog.rpartition(" ")[2], self)
        return super().parse_known_args(args, namespace)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="servolink",
        description="Drive a servo control board.",
        epilog=EXIT_CODES,
        parents=[common_options(given=False)],
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=_Command)
    common: list[Any] = [common_options(given=True)]
    for name, (module, text) in COMMANDS.items():
        command = commands.add_parser(
            name,
            help=text,
            description=text[:1].upper() + text[1:] + ".",
            epilog=EXIT_CODES,
            parents=common,
            allow_abbrev=False,  # what is dangerous must be spelled out
        )
        command.module = module
        command.set_defaults(parser=command)
    return parser


def common_options(*, given: bool) -> argparse.ArgumentParser:
    """Options that may stand before the command, and (`given`) after it without undoing those before."""
    parser = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)

    def default(value: object) -> object:
        return argparse.SUPPRESS if given else value

    url = os.environ.get("SERVOLINK_URL") or None
    parser.add_argument("--url", type=not_empty, default=default(url), help="the board (or SERVOLINK_URL)")
    parser.add_argument("--json", action="store_true", default=default(value=False), help="print JSON for programs")
    parser.add_argument(
        "--byte-order", choices=("little", "big"), default=default("little"), help="of numbers in packets (little)"
    )
    parser.add_argument(
        "--caption-encoding",
        type=caption_encoding,
        default=default("utf-8"),
        metavar="NAME",
        help="of captions, such as big5 (utf-8)",
    )
    return parser
