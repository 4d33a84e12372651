"""Index of all commands: only the module of the typed command is imported.

`commands.json` is made from the declarations: `python -m docs.command_index` writes it anew.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from importlib.resources import files
from types import ModuleType
from typing import NamedTuple

from servolink.cli.command import Command

TABLE = files("servolink.cli") / "commands.json"


class IndexEntry(NamedTuple):
    """A command as `servolink --help` and completion need it."""

    module: str
    """Module with the declaration, below `servolink.cli`."""
    topic: str
    help: str
    options: dict[str, str | None]
    """Metavar of the value of each option, or choices with `|` between them; None for a flag."""
    arguments: list[str]
    """Metavar or choices of each argument; repeatable arguments end in `...`."""


@cache
def index() -> dict[str, IndexEntry]:
    """Return all commands by name, in the order of the help."""
    return {name: IndexEntry(*entry) for name, entry in json.loads(TABLE.read_bytes()).items()}


def below(name: str) -> dict[str, IndexEntry]:
    """Return the subcommands of a command by their last word; of the empty name, all commands."""
    found = {each.rpartition(" "): entry for each, entry in index().items()}
    return {word: entry for (start, _, word), entry in found.items() if start == name and word}


def load(name: str) -> Command:
    """Return the declaration of a command, from its module."""
    module = import_module(f"servolink.cli.{index()[name].module}")
    return next(command for command in declared(module) if command.name == name)


def declared(module: ModuleType) -> Iterator[Command]:
    """Yield the commands of a module."""
    for value in vars(module).values():
        each = value if isinstance(value, tuple) else (value,)
        yield from (command for command in each if isinstance(command, Command))
