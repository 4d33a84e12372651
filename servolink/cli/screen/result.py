"""Result of a command: a value whose fields are the JSON of `--json`, and the same as text and tables for people."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, NamedTuple, TypeAlias

from msgspec import UNSET, Struct, UnsetType, to_builtins

from servolink.cli.screen.output import Form, Table, print_error, print_table, print_text
from servolink.support import ExitCode


class CommandResult(Struct, frozen=True):
    """Value that a command returns or, line by line, prints; the docstring of each class names its commands."""


class Remark(str):
    """Sentence for people that goes to standard error."""

    __slots__ = ()


class Verbatim(str):
    """Text for other programs, such as a file: nothing in it is escaped, and no line is added."""

    __slots__ = ()


Part: TypeAlias = "str | tuple[str, str] | Table"
"""Line, line with its rich style, or table."""
Text: TypeAlias = "Part | Iterable[Text]"
"""One part, or several; not a tuple of lines, which would be a line and its style."""


Value: TypeAlias = "CommandResult | dict[str, Any]"
"""What programs read: a struct, or an object whose form is described elsewhere, such as a packet."""


class Returned(NamedTuple):
    """Value of a command, the text that people read in its place, and the exit code."""

    value: Value
    text: Text = ()
    code: ExitCode = ExitCode.OK


Ending: TypeAlias = Returned | int
"""End of a command: its value, or an exit code after the output."""


def ended(ending: Ending) -> int:
    """Show the value of a command, unless it was shown, and return the exit code."""
    if isinstance(ending, Returned):
        show(ending.value, ending.text)
        return ending.code
    return int(ending)


def show(value: Value, text: Text = ()) -> None:
    """Print `value` as one object for programs, or `text` for people."""
    show_all([value], text)


def show_all(values: Iterable[Value], text: Text) -> None:
    """Print each of `values` as an object on a line of ASCII, or `text` for people."""
    for value in values if Form.json else ():
        print(json.dumps(to_builtins(value, enc_hook=int)), flush=True)
    print_for_people(text)


def print_for_people(text: Text) -> None:
    """Print lines and tables, and remarks on standard error; nothing with --json."""
    if Form.json:
        return
    if isinstance(text, Remark):
        print_error(f"servolink: {text}")
    elif isinstance(text, Verbatim):
        print(text, end="", flush=True)
    elif isinstance(text, str):
        print_text(text)
    elif isinstance(text, Table):
        print_table(text)
    elif isinstance(text, tuple) and text:
        print_text(*map(str, text))
    else:
        for part in text:
            print_for_people(part)


class Served(CommandResult, frozen=True):
    """JSON of addresses of `virtual`, `replay`, `share`, `spy`, `studio`, `mcp`, `ros2`, `foxglove`, `fleet metrics`.

    Only `mcp` has a token; `drive` and `watch` are pages of the studio for other machines; `ros2` is a node.
    """

    listening: str | UnsetType = UNSET
    studio: str | UnsetType = UNSET
    drive: str | UnsetType = UNSET
    watch: str | UnsetType = UNSET
    mcp: str | UnsetType = UNSET
    token: str | UnsetType = UNSET
    foxglove: str | UnsetType = UNSET
    ros2: str | UnsetType = UNSET
    metrics: str | UnsetType = UNSET


def show_served(**addresses: str) -> None:
    """Print addresses by name, a line each, or all as one object."""
    show(Served(**addresses), [f"{name} {address}" for name, address in addresses.items()])
