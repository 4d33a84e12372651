"""servolink/cli/commands.json, made from the declarations of the commands.

`python -m docs.command_index` writes it anew. New commands come last; move their lines to where the help shows them.
"""

from __future__ import annotations

import argparse
import json
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

from servolink import cli
from servolink.cli.command import Command
from servolink.cli.command_line import WHOLE, parser_of
from servolink.cli.index import TABLE, IndexEntry, declared

_SEVERAL = {argparse.ZERO_OR_MORE, argparse.ONE_OR_MORE}


def entries() -> dict[str, IndexEntry]:
    """Return an entry for each command that is declared, in the order of the file that there is."""
    found = {"": _entry(WHOLE, "parser")}
    for module in walk_packages(cli.__path__, "servolink.cli."):
        for command in declared(import_module(module.name)):
            found[command.name] = _entry(command, module.name.removeprefix("servolink.cli."))
    known = list(json.loads(Path(str(TABLE)).read_bytes())) if Path(str(TABLE)).exists() else []
    return dict(sorted(found.items(), key=lambda each: known.index(each[0]) if each[0] in known else len(known)))


def text() -> str:
    """Return the text of the file, a command a line."""
    lines = (f"{json.dumps(name)}: {json.dumps(entry)}" for name, entry in entries().items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _entry(command: Command, module: str) -> IndexEntry:
    parser = parser_of(command)
    flags, arguments = dict[str, str | None](), list[str]()
    for action in parser._actions:  # noqa: SLF001 - argparse has no other way to walk over them
        value = value_of(action)
        if not action.option_strings and action.nargs != argparse.PARSER:
            arguments.append(f"{value}{'...' if action.nargs in _SEVERAL else ''}")
        flags |= dict.fromkeys(action.option_strings, value if action.nargs != 0 else None)
    return IndexEntry(module, command.topic, command.help, flags, arguments)


def value_of(action: argparse.Action) -> str:
    """Return how the help names the value of an option or argument."""
    if action.choices is not None:
        return "|".join(action.choices)
    metavar = action.metavar or action.dest.upper()
    return metavar if isinstance(metavar, str) else " ".join(metavar)


if __name__ == "__main__":
    Path(str(TABLE)).write_text(text(), encoding="ascii")
