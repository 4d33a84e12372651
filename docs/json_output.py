"""docs/reference/json-output.md and its JSON Schema, made from the results that commands return."""

from __future__ import annotations

import inspect
import json
import pkgutil
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec

import servolink.cli
from servolink.cli.index import index
from servolink.cli.screen.result import CommandResult
from servolink.cli.stored import NOUNS

_FOLDER = Path(__file__).parent
PAGE = _FOLDER / "reference/json-output.md"
SCHEMA = _FOLDER / "reference/json-output.schema.json"

OTHER_FORMS = {
    "action show": "the action in the form of a [project file](project-file.md); likewise `actions NAME`",
    "macro show": "the macro in the form of a project file; likewise `macros NAME`",
    "table show": "the joystick table in the form of a project file; likewise `tables NAME`",
    "project show": "the project in the form of a project file, with `stored_bytes` and `duration_seconds` by id",
    "request": "the response of the board as a packet: `packet`, `id`, `fields`; or `sent`, the name of a command",
    "decode": "a line for each packet, as `request`; or `error` or `skipped` with `bytes` in hex",
    "spy": "a line for each packet, as `decode`, with `seconds`, `from` and `byte_order`, before its report",
    "share": "with --status [HubStatus](control-interface.md#hubstatus)",
    "fleet watch": "a line for each board that changes: [BoardNow](fleet.md#boardnow) with `board`, `is_online` and "
    "`unreadable`",
}
"""Commands whose JSON, or a part of it, has a form that another page describes."""

WITHOUT = {
    "help": "prints the help",
    "completion": "prints a script",
    "complete": "prints words for a shell",
    "project schema": "prints a JSON Schema",
    "remote": "needs a terminal",
    "twin measure": "asks for each movement, which needs a terminal",
    **dict.fromkeys(
        ("action", "macro", "table", "servo", "project", "twin", "figure", "firmware", "fleet"), "has subcommands"
    ),
}
"""Commands without JSON of their own, with the reason."""

_INTRODUCTION = """\
# JSON of the commands

Output of each command [with `--json`](command-line.md#for-programs). This page and the
[JSON Schema](json-output.schema.json) of all types are made from the declarations in `servolink/cli/`. New versions may
add fields, but do not rename or remove any. Fields without a meaning in a certain case are left out.

These commands print a form that another page describes:

| command | form |
|---|---|
{others}

"""


@cache
def results() -> dict[str, type[CommandResult]]:
    """Return the type of each result by name, in the order of the help."""
    for module in pkgutil.walk_packages(servolink.cli.__path__, "servolink.cli."):
        import_module(module.name)
    waiting, found = [CommandResult], list[type[CommandResult]]()
    while waiting:
        found += (more := waiting.pop().__subclasses__())
        waiting += more
    order = list(index())
    found.sort(key=lambda each: (min(order.index(name) for name in commands_of(each)), each.__name__))
    return {each.__name__: each for each in found}


def commands_of(result: type[CommandResult]) -> list[str]:
    """Return the commands that the docstring of a result names; NOUN stands for each type of record."""
    words = re.findall(r"`([\w -]+)`", inspect.getdoc(result) or "")
    each = [word.replace("NOUN", noun) for word in words for noun in (NOUNS if "NOUN" in word else ("",))]
    return [word for word in each if word in index()]


@cache
def schema() -> dict[str, Any]:
    """Return the JSON Schema of all results, by name of the type."""
    _, parts = msgspec.json.schema_components(results().values(), ref_template="#/$defs/{name}")
    for part in parts.values():
        if "description" in part:
            part["description"] = inspect.cleandoc(part["description"])
    commands: dict[str, list[str]] = {}
    for name, result in results().items():
        for command in commands_of(result):
            commands.setdefault(command, []).append(name)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "JSON that servolink prints with --json",
        "commands": commands,
        "$defs": dict(sorted(parts.items())),
    }


def schema_text() -> str:
    """Return the file of the schema."""
    return json.dumps(schema(), indent=1) + "\n"


def page() -> str:
    """Return the page."""
    others = "\n".join(f"| `{name}` | {form} |" for name, form in OTHER_FORMS.items())
    parts = [_INTRODUCTION.format(others=others)]
    shown = list(results())
    parts += ["## Results\n\n", *(_section(name) for name in shown)]
    inner = [name for name in schema()["$defs"] if name not in shown]
    parts += ["## Parts\n\n", *(_section(name) for name in inner)]
    return "".join(parts).rstrip("\n") + "\n"


def _section(name: str) -> str:
    described = schema()["$defs"][name]
    text = " ".join(described.get("description", "").split())
    rows = "\n".join(_rows(described))
    table = f"\n\n| field | type |\n|---|---|\n{rows}" if rows else ""
    values = "" if rows else f"\n\nOne of {_type(described)}."
    return f"### {name}\n\n{text}{table}{values}\n\n"


def _rows(described: dict[str, Any]) -> Iterator[str]:
    required = set(described.get("required", ()))
    for field, form in described.get("properties", {}).items():
        is_left_out = field not in required and "default" not in form
        yield f"| `{field}` | {_type(form)}{', or left out' if is_left_out else ''} |"


def _type(form: dict[str, Any]) -> str:
    """Return a type of the schema in words."""
    if "$ref" in form:
        name = form["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in form:
        return " or ".join(dict.fromkeys(map(_type, form["anyOf"])))
    if "enum" in form:
        return ", ".join(f"`{value}`" for value in form["enum"])
    kind = form.get("type", "any value")
    if kind == "array":
        return f"list of {_type(form['items'])}" if form.get("items") else "list"
    if kind == "object" and isinstance(form.get("additionalProperties"), dict):
        inner = _type(form["additionalProperties"])
        return f"object of ({inner})" if " or " in inner else f"object of {inner}"
    return str(kind)
