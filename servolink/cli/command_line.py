"""The parser of the command line: built for the command that was typed, with suggestions for typos."""

from __future__ import annotations

import argparse
import os
import platform
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from textwrap import fill
from typing import Any, NoReturn

from servolink.cli.arguments import caption_encoding, not_empty, timeout
from servolink.cli.command import TOPICS, Command, Group, flag, group, option
from servolink.cli.index import IndexEntry, below, load
from servolink.cli.usage import WrongUsage, usage_error
from servolink.errors import quote

EXIT_CODES = "exit codes: 0 ok, 1 failed, 2 wrong usage, 3 no board, 130 interrupted"

_USUAL_COLUMNS = 80
_ELSEWHERE = {"version": "--version"}  # typed as commands by people who know other tools
_NEGATIVE = re.compile(r"-\.?\d")


class _Version(argparse.Action):
    """Prints the version and exits."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """Print the version; finding it takes a while, so not before."""
        import servolink

        python = f"{platform.python_implementation()} {platform.python_version()}"
        print(f"servolink {servolink.__version__} on {python}, {platform.system()} {platform.machine()}", flush=True)
        parser.exit()


COMMON = (
    flag("-h --help", "show this help and exit", action="help"),
    flag("--json", "print JSON for programs"),
    flag("-v --verbose", "log to standard error; -vv logs each frame", action="count", default=0),
    option("--byte-order", "little|big", "of numbers in packets (little)"),
    option("--caption-encoding", "NAME", "of captions, such as big5 (utf-8)", caption_encoding),
)
"""Options of all commands, accepted before and after the name of the command."""
BOARD = option(
    "-b --board --url",
    "BOARD",
    "address or name of the board (SERVOLINK_BOARD; the only one here)",
    not_empty,
    dest="url",
)


def _common(command: Command) -> Group:
    """Return the common options that a command has."""
    how_long = timeout(f"how long to wait for each response, {command.patience} unless given")
    first, *others = COMMON
    return group("common options", first, *((BOARD, how_long) if command.takes_board else ()), *others)


WHOLE = Command(
    "",
    help="drive a servo control board",
    options=(flag("--version", "print the version and exit", action=_Version, nargs=0),),
)
"""Declaration of `servolink` itself."""


class Parser(argparse.ArgumentParser):
    """Parser of a command; the command without a name is the whole command line."""

    def __init__(self, command: Command) -> None:
        self.declaration = command
        self.subcommands = below(command.name)
        super().__init__(
            prog=f"servolink {command.name}".rstrip(),
            usage=_usage(command) if self.subcommands else None,
            description=_description(command, self.subcommands),
            epilog=_epilog(command),
            add_help=False,
            allow_abbrev=False,
            formatter_class=_HelpFormatter,
        )
        for each in (_common(command), *command.options):
            each.add_to(self)
        if self.subcommands:
            subcommand = self.add_argument(
                argparse.SUPPRESS, nargs=argparse.PARSER, action=_Subcommand, metavar="COMMAND", help=argparse.SUPPRESS
            )
            subcommand.required = False

    def parse_known_args(  # pyright: ignore[reportIncompatibleMethodOverride] - it is overloaded
        self, args: Iterable[str] | None = None, namespace: Any = None
    ) -> Any:
        """Parse, and complain about unknown options before anything else."""
        given = sys.argv[1:] if args is None else list(args)
        for word in given:
            if word == "--" or word in self.subcommands:
                break
            self._check_option(word)
        command, parsed = self.declaration, namespace or argparse.Namespace(url=None, timeout=None)
        vars(parsed).update(command.defaults, parser=self, command=command.name, run=command.run)
        _, unknown = super().parse_known_args(given, parsed)
        if unknown:
            usage_error(parsed, f"unexpected argument: {unknown[0]}{command.hint}")
        if parsed.run is None and not command.name:
            self.print_help()
            self.exit()
        if parsed.run is None:
            self.error(f"no command is given; `{self.prog} --help` lists the commands")
        return parsed, []

    def _check_option(self, word: str) -> None:
        """End as wrong usage if `word` is an unknown option: argparse may read an unknown option as a value."""
        name = word.partition("=")[0]
        known = self._option_string_actions
        if not name.startswith("-") or name == "-" or " " in word or _NEGATIVE.match(word) or name in known:
            return
        if name.startswith("--") or name[:2] not in known:  # -vv is -v twice
            meant = _closest(name, known)
            self.error(f"`{self.prog}` has no option {name}{f'; did you mean {meant}?' if meant else ''}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            raise argparse.ArgumentError(action, f"must be {' or '.join(map(str, action.choices))}, not {quote(value)}")

    def parse_subcommand(self, words: Sequence[str], namespace: argparse.Namespace) -> None:
        """Parse the words from the name of a subcommand on."""
        word, *rest = words
        if word not in self.subcommands:
            meant = _closest(word, [*self.subcommands, *_ELSEWHERE])
            hint = _ELSEWHERE.get(meant, meant)
            hint = f"did you mean {hint}?" if hint else f"`{self.prog} --help` lists the commands"
            self.error(f"there is no command {quote(word)}; {hint}")
        parser_of(load(f"{self.declaration.name} {word}".lstrip())).parse_known_args(rest, namespace)

    def error(self, message: str) -> NoReturn:
        """End as wrong usage."""
        raise WrongUsage(self, message)

    def print_help(self, file: Any = None) -> None:
        """Print the help, or fail: argparse ignores a stream that takes no more."""
        print(self.format_help(), file=file, end="", flush=True)


class _Subcommand(argparse.Action):
    """Has the rest of the command line parsed by the parser of the subcommand."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, _: str | None = None) -> None:
        """Parse it."""
        parser.parse_subcommand(values, namespace)


def parser_of(command: Command = WHOLE) -> Parser:
    """Return the parser of a command, or of the whole command line."""
    return Parser(command)


class _HelpFormatter(argparse.HelpFormatter):
    """Keeps line breaks, and leaves the common options out of the usage: they are the same for every command."""

    def __init__(self, prog: str) -> None:
        """Fill the width of the terminal, as argparse does, but without its import of `shutil` with all compressors."""
        super().__init__(prog, width=_columns() - 2)

    def add_usage(self, usage: Any, actions: Iterable[argparse.Action], groups: Any, prefix: Any = None) -> None:
        """Add the usage."""
        common = {name for each in (*COMMON, BOARD, timeout("")) for name in each.names}
        own = [action for action in actions if common.isdisjoint(action.option_strings)]
        super().add_usage(usage, own, groups, prefix)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return "\n".join(_filled(line, width) if len(line) > width else line for line in text.split("\n"))


def _columns() -> int:
    """Return the width of the terminal, or the number in COLUMNS; 80 if neither is known."""
    columns = os.environ.get("COLUMNS", "")
    if columns.isdecimal() and int(columns):
        return int(columns)
    try:
        return os.get_terminal_size().columns or _USUAL_COLUMNS
    except OSError:
        return _USUAL_COLUMNS


def _filled(line: str, width: int) -> str:
    """Return a line wrapped; further lines of a list item begin below the text of the first line."""
    item = re.match(r"  \S+ +", line)
    return fill(line, width, subsequent_indent=" " * len(item[0]) if item else "")


def _usage(command: Command) -> str:
    """Return the usage of a command that has subcommands."""
    if not command.name:
        return "servolink [OPTIONS] COMMAND ..."
    return f"servolink {command.name} {'[COMMAND ...]' if command.run else 'COMMAND ...'}"


def _description(command: Command, subcommands: Mapping[str, IndexEntry]) -> str:
    """Return the description of a command, with the list of subcommands by topic."""
    parts = [f"{command.help[:1].upper()}{command.help[1:]}."]
    if command.details:
        parts.append(command.details)
    topics = ("",) if command.name else TOPICS
    width = max(map(len, subcommands), default=0) + 2
    for topic in topics if subcommands else ():
        lines = (f"  {name:{width}}{each.help}" for name, each in subcommands.items() if each.topic == topic)
        parts.append("\n".join([f"{topic or 'commands'}:", *lines]))
    return "\n\n".join(parts)


def _epilog(command: Command) -> str:
    """Return the end of the help: examples, a hint for examples, and exit codes."""
    if not command.name:
        return f"`servolink COMMAND --help` explains a command and gives examples.\n\n{EXIT_CODES}"
    examples = "\n".join(f"  servolink {example}" for example in command.examples)
    hint = "  (add --board virtual:// to try them without a board)\n"
    if command.needs_records:
        hint = "  (on a board with something stored, as by `servolink apply FILE`)\n"
    return f"examples:\n{examples}\n{hint if command.takes_board else ''}\n{EXIT_CODES}"


def _closest(word: str, known: Iterable[str]) -> str:
    """Return the known word closest to `word`, or "" if none is close."""
    known = list(known)
    begun = [each for each in known if each.startswith(word)]
    bare = {each.lstrip("-"): each for each in known}  # or two dashes alone make short options alike
    found = begun or [bare[each] for each in get_close_matches(word.lstrip("-"), bare, 1)]
    return found[0] if found else ""
