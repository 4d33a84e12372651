"""The parser of the command line: options loaded with their command, suggestions for typos, help by topic."""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from collections.abc import Iterable, Mapping
from textwrap import fill
from typing import Any, NoReturn

from servolink.cli.arguments import add_timeout, caption_encoding, not_empty
from servolink.cli.commands import COMMANDS, PATIENCE, TOPICS, Command
from servolink.escaping import escape

EXIT_CODES = "exit codes: 0 ok, 1 failed, 2 wrong usage, 3 no board, 130 interrupted"

_COMMON = {"help", "url", "json", "verbose", "timeout", "byte_order", "caption_encoding"}
_ELSEWHERE = {"help": "--help", "version": "--version"}  # typed as commands by people who know other tools
_NEGATIVE = re.compile(r"-\.?\d")


class Parser(argparse.ArgumentParser):
    """Parses the whole command line, or one command, whose module is imported only when the command is given."""

    def __init__(self, **options: Any) -> None:
        """Take the `options` of ArgumentParser."""
        super().__init__(add_help=False, allow_abbrev=False, formatter_class=_HelpFormatter, **options)
        self.command: Command | None = None
        """The command whose options are not loaded yet."""
        self.commands: argparse._SubParsersAction[Any] | None = None

    def add_commands(self, table: Mapping[str, Command], dest: str, *, required: bool = True, **options: Any) -> None:
        """Add a parser for each command, and keep the name of the given one as `dest`."""
        self.commands = commands = self.add_subparsers(
            dest=dest, required=required, metavar="COMMAND", prog=self.prog, **options
        )
        for name, command in table.items():
            parser = commands.add_parser(
                name,
                help=command.help,
                description=f"{command.help[:1].upper()}{command.help[1:]}.",
                epilog=_epilog(command),
            )
            parser.command = command
            parser.set_defaults(parser=parser)

    def load(self) -> None:
        """Add the common options, and those of the command from its module."""
        if self.command:
            command, self.command = self.command, None
            _add_common_options(self, is_first=False, takes_board=command.takes_board, patience=command.patience)
            module, _, function = command.place.partition(":")
            getattr(importlib.import_module(f"servolink.cli.{module}"), function)(self)

    def parse_known_args(  # pyright: ignore[reportIncompatibleMethodOverride] - it is overloaded
        self, args: Iterable[str] | None = None, namespace: Any = None
    ) -> Any:
        """Parse, once the options are there, and complain about unknown options before anything else."""
        self.load()
        given = sys.argv[1:] if args is None else list(args)
        for word in given:
            if word == "--" or (self.commands and word in self.commands.choices):
                break
            self._check_option(word)
        return super().parse_known_args(given, namespace)

    def _check_option(self, word: str) -> None:
        """End as wrong usage if `word` is an option that does not exist, which argparse may take for a value."""
        name = word.partition("=")[0]
        known = self._option_string_actions
        if not name.startswith("-") or name == "-" or " " in word or _NEGATIVE.match(word) or name in known:
            return
        if name.startswith("--") or name[:2] not in known:  # -vv is -v twice
            meant = _closest(name, known)
            self.error(f"`{self.prog}` has no option {name}{f'; did you mean {meant}?' if meant else ''}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        if action is not self.commands:
            raise argparse.ArgumentError(action, f"must be {' or '.join(map(str, action.choices))}, not {value!r}")
        meant = _closest(value, [*action.choices, *_ELSEWHERE])
        hint = f"did you mean {_ELSEWHERE.get(meant, meant)}?" if meant else f"`{self.prog} --help` lists the commands"
        raise argparse.ArgumentError(None, f"there is no command {value!r}; {hint}")

    def error(self, message: str) -> NoReturn:
        """End as wrong usage."""
        super().error(escape(message))

    def print_help(self, file: Any = None) -> None:
        """Print the help, or fail: argparse ignores a stream that takes no more."""
        print(self.format_help(), file=file, end="", flush=True)


def build_parser() -> Parser:
    """Return the parser of `servolink`."""
    parser = Parser(
        prog="servolink",
        usage="servolink [OPTIONS] COMMAND ...",
        description=f"Drive a servo control board.\n\n{_topics()}",
        epilog=f"`servolink COMMAND --help` explains a command and gives examples.\n\n{EXIT_CODES}",
    )
    _add_common_options(parser, is_first=True)
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    parser.add_commands(COMMANDS, "command", help=argparse.SUPPRESS)
    return parser


def _add_common_options(parser: Parser, *, is_first: bool, takes_board: bool = True, patience: str = PATIENCE) -> None:
    """Add the options of all commands, which may stand before the command and after it.

    Those before (`is_first`) have the defaults; those after it have none, so as not to undo the ones before.
    """
    group = parser.add_argument_group("common options")

    def default(value: object) -> object:
        return value if is_first else argparse.SUPPRESS

    group.add_argument("-h", "--help", action="help", help="show this help and exit")
    if takes_board:
        group.add_argument(
            *("-b", "--board", "--url"),
            dest="url",
            type=not_empty,
            default=default(None),
            metavar="BOARD",
            help="address or name of the board (SERVOLINK_BOARD; the only one here)",
        )
        add_timeout(group, default(None), f"how long to wait for each response, {patience} unless given")
    group.add_argument("--json", action="store_true", default=default(value=False), help="print JSON for programs")
    group.add_argument(
        "-v", "--verbose", action="count", default=default(0), help="log to standard error; -vv logs each frame"
    )
    group.add_argument(
        "--byte-order", choices=("little", "big"), default=default(None), help="of numbers in packets (little)"
    )
    group.add_argument(
        "--caption-encoding",
        type=caption_encoding,
        default=default(None),
        metavar="NAME",
        help="of captions, such as big5 (utf-8)",
    )


class _HelpFormatter(argparse.HelpFormatter):
    """Keeps line breaks, and leaves the common options out of the usage: they are the same for every command."""

    def add_usage(self, usage: Any, actions: Iterable[argparse.Action], groups: Any, prefix: Any = None) -> None:
        """Add the usage."""
        own = [action for action in actions if action.dest not in _COMMON]
        super().add_usage(usage, own, groups, prefix)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return "\n".join(fill(line, width) if len(line) > width else line for line in text.split("\n"))


class _Version(argparse.Action):
    """Prints the version and exits."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """Print the version; finding it takes a while, so not before."""
        import platform

        import servolink

        python = f"{platform.python_implementation()} {platform.python_version()}"
        print(f"servolink {servolink.__version__} on {python}, {platform.system()} {platform.machine()}", flush=True)
        parser.exit()


def _topics() -> str:
    width = max(map(len, COMMANDS)) + 2
    return "\n\n".join(
        "\n".join(
            [f"{topic}:", *(f"  {name:{width}}{each.help}" for name, each in COMMANDS.items() if each.topic == topic)]
        )
        for topic in TOPICS
    )


def _epilog(command: Command) -> str:
    examples = "\n".join(f"  servolink {example}" for example in command.examples)
    hint = "  (add --board virtual:// to try them without a board)\n"
    if command.needs_records:
        hint = "  (on a board with something stored, as by `servolink apply FILE`)\n"
    return f"examples:\n{examples}\n{hint if command.takes_board else ''}\n{EXIT_CODES}"


def _closest(word: str, known: Iterable[str]) -> str:
    """Return what was probably meant by `word`, or "" if nothing is like it."""
    from difflib import get_close_matches

    known = list(known)
    begun = [each for each in known if each.startswith(word)]
    bare = {each.lstrip("-"): each for each in known}  # or two dashes alone make short options alike
    found = begun or [bare[each] for each in get_close_matches(word.lstrip("-"), bare, 1)]
    return found[0] if found else ""
