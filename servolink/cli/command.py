"""A command, declared once, beside the code: name, topic, help, examples, options and function to run."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypedDict, Unpack

if TYPE_CHECKING:
    from servolink.cli.screen.result import Ending

    class Settings(TypedDict, total=False):
        """Other settings of an option, as `ArgumentParser.add_argument` takes them."""

        action: str | type[argparse.Action]
        choices: Iterable[str]
        const: Any
        default: Any
        dest: str
        nargs: int | str


FIRST_STEPS = "first steps"
MOVE = "move"
RECORDINGS = "recordings"
STORED = "what is stored"
PROJECTS = "projects"
TOGETHER = "together"
DEVELOPERS = "for developers"

TOPICS = (FIRST_STEPS, MOVE, STORED, PROJECTS, TOGETHER, RECORDINGS, DEVELOPERS)
"""In the order of `servolink --help`."""

PATIENCE = "3"
"""Default of `--timeout` in seconds, for most commands."""

Run: TypeAlias = "Callable[[argparse.Namespace], Ending]"


class Option(NamedTuple):
    """One option or argument."""

    names: list[str]
    settings: dict[str, Any]

    def add_to(self, parser: Any) -> None:
        """Add the declaration to a parser or to a group of a parser."""
        parser.add_argument(*self.names, **self.settings)


class Group(NamedTuple):
    """Options under a separate title, or mutually exclusive options."""

    options: tuple[Option | Group, ...]
    title: str = ""
    """Heading in the help; empty for mutually exclusive options."""
    required: bool = False

    def add_to(self, parser: Any) -> None:
        """Add the declaration to a parser or to a group of a parser."""
        add = parser.add_argument_group if self.title else parser.add_mutually_exclusive_group
        into = add(self.title) if self.title else add(required=self.required)
        for each in self.options:
            each.add_to(into)


def late(place: str) -> Run:
    """Return the function at `place`, such as `stored.edit:run_add`; the module is imported at the first call."""
    module, _, function = place.partition(":")

    def run(args: argparse.Namespace) -> Ending:
        return getattr(import_module(f"servolink.cli.{module}"), function)(args)  # type: ignore[no-any-return]

    return run


def option(
    names: str,
    metavar: str | tuple[str, ...],
    help: str,  # noqa: A002 - as argparse calls it
    read: Callable[[str], Any] | None = None,
    **settings: Unpack[Settings],
) -> Option:
    """Return an option with a value, or an argument; `names` as in `-o --output`.

    `read` takes the text of the value, and raises ArgumentTypeError for a wrong one. Without it, a `metavar` such as
    `degree|adc` lists the values that are allowed.
    """
    if read is None and isinstance(metavar, str) and "|" in metavar:
        settings.setdefault("choices", metavar.split("|"))
    return Option(names.split(), {"metavar": metavar, "help": help, "type": read, **settings})


def flag(names: str, help: str, **settings: Unpack[Settings]) -> Option:  # noqa: A002 - as argparse calls it
    """Return an option without a value."""
    return Option(names.split(), {"action": "store_true", "help": help, **settings})


def group(title: str, *options: Option | Group) -> Group:
    """Return options that the help shows under a title of their own."""
    return Group(options, title)


def one_of(*options: Option, required: bool = False) -> Group:
    """Return options that exclude each other."""
    return Group(options, required=required)


class Command:
    """Declaration of a command, and decorator of the function to run; a command without a function has subcommands.

    Not a dataclass, as those take a fifth of the time of `servolink --help` to load.
    """

    def __init__(
        self,
        name: str,
        topic: str = "",
        *,
        help: str,  # noqa: A002 - as argparse calls it
        details: str = "",
        examples: tuple[str, ...] = (),
        options: tuple[Option | Group, ...] = (),
        defaults: Mapping[str, Any] | None = None,
        takes_board: bool = True,
        patience: str = PATIENCE,
        needs_records: bool = False,
        hint: str = "",
        run: Run | None = None,
    ) -> None:
        self.name = name
        """As it is typed, such as `move` or `project show`."""
        self.topic = topic
        """Heading in `servolink --help`; empty for subcommands."""
        self.help = help
        self.details = details
        """Further paragraphs of its own help."""
        self.examples = examples
        """Words after `servolink`, each for a fresh board; a test runs all examples on virtual boards."""
        self.options = options
        self.defaults = defaults or {}
        """Further values of the arguments passed to `run`."""
        self.takes_board = takes_board
        """Whether it has the options `--board` and `--timeout`."""
        self.patience = patience
        """Default of `--timeout` in seconds, shown in the help."""
        self.needs_records = needs_records
        """Whether its examples need something stored on the board."""
        self.hint = hint
        """Advice behind the error for an unexpected argument."""
        self.run = run

    def __call__(self, run: Run) -> Command:
        """Return this command, run by a function."""
        return self.changed(run=run)

    def changed(self, **changes: Any) -> Command:
        """Return a copy with other attributes."""
        return Command(**{**vars(self), **changes})
