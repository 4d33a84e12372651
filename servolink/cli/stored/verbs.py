"""`add`, `set`, `rename` and `delete` of actions, macros and tables: the options; the functions are imported late."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

from servolink.cli.arguments import RECORD_ID, RECORD_NAME, file_path, number, or_caption, whole_number
from servolink.cli.command import Command, Option, flag, late, option
from servolink.cli.motion.move import servo_angle
from servolink.cli.stored import NOUNS, a
from servolink.errors import quote

DEFAULT_SECONDS = 1.0
"""Of an action, if none are given."""

_WHAT = r"(?:(action|macro|wait):|(?=name:)|(?![^:]*:))(.+?)"  # a colon after another word is a typing error
_PART = re.compile(rf"{_WHAT}(?:x([0-9]+))?(?:@([0-9]+))?", re.ASCII | re.DOTALL)
_BUTTON = whole_number(0, 2**32 - 1)
_MACRO_OR_NONE = or_caption(whole_number(0, 2**31 - 1))


class MacroPart(NamedTuple):
    """A part of a macro, as it is typed."""

    word: str
    """`action`, `macro`, `wait`, or empty for a caption of an action or a macro."""
    value: int | str
    """Id or caption; for `wait` milliseconds."""
    loop: int
    ratio: int


def _each(read: Callable[[str], Any], text: str) -> list[Any]:
    return [read(part) for part in text.split(",")]


def _part(text: str) -> MacroPart:
    found = _PART.fullmatch(text)
    if found is None:
        raise argparse.ArgumentTypeError(
            f"{quote(text)} must be CAPTION, action:NAME, macro:NAME or wait:SECONDS, with x3 to repeat it and @50 "
            "for half the speed"
        )
    word, value = found[1] or "", found[2]
    loop = whole_number(0, 0x7FFF)(found[3] or "1")
    ratio = whole_number(1, 100)(found[4] or "100")
    if word == "wait":
        return MacroPart(word, round(number(0, 2_147_483, "seconds")(value) * 1000), loop, ratio)
    name = RECORD_NAME(value)
    if not word and isinstance(name, int):
        raise argparse.ArgumentTypeError(
            f"{quote(text)} must say of what it is the id, as in action:{name} or macro:{name}"
        )
    return MacroPart(word, name, loop, ratio)


def _assigned(text: str) -> tuple[int, int | str]:
    button, equals, macro = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{quote(text)} must be BUTTON=MACRO, such as 7=1")
    return _BUTTON(button), _MACRO_OR_NONE(macro)


def _action(seconds: str) -> tuple[Option, ...]:
    """Return the options that describe an action; `seconds` is the help text about the default duration."""
    return (
        option(
            "--pose", "SERVO=ANGLE,...", "angles of servos, such as 1=30,hip=-10 or all=0", partial(_each, servo_angle)
        ),
        option("--seconds", "N", f"duration in steps of 0.01 s ({seconds})", number(0, 327.67, "seconds")),
    )


_MACRO = (
    option(
        "--play",
        "PART,...",
        "one after the other: CAPTION, action:NAME, macro:NAME or wait:SECONDS; x3 repeats, @50 is half the speed",
        partial(_each, _part),
    ),
)
_TABLE = tuple(
    option(
        name,
        "BUTTON=MACRO",
        f"start a macro, by caption or id, when a button {when}; 0: none",
        _assigned,
        action="append",
    )
    for name, when in (("--press", "is pressed"), ("--long-press", "is held down"), ("--up", "is released"))
)
_NAME = option("record", "NAME", "its caption or id, as in the list", RECORD_NAME)


class _Noun(NamedTuple):
    """Differences between actions, macros and tables."""

    options: tuple[Option, ...]
    """Options for the content of a record."""
    needed: str
    """Options required for a new record, at least one, in words."""
    new: str
    """Example of a new one."""
    in_file: str
    """Caption of one in the project file of examples."""
    change: str
    """Example of a change."""
    unused: int
    """Id, in examples, of an unused record, which may be deleted."""


_TYPES = {
    "action": _Noun(_action("as before"), "--pose", "Wave --pose 1=30,2=-10 --seconds 0.5", "Bow", "--seconds 2", 2),
    "macro": _Noun(
        _MACRO, "--play", "Dance --play action:1,wait:0.5,action:1x3@50", "Greet", "--play action:1,wait:1", 2
    ),
    "table": _Noun(_TABLE, "--press, --long-press or --up", "Left --press 7=1 --up 8=1", "Pad", "--long-press 3=1", 1),
}
_JSON = "a record as JSON, which begins with {, or @FILE or - (standard input) with it"


def _source(what: str) -> Option:
    return option("--from", "FILE", f"take {what}, of this project file", file_path, dest="source")


def _commands(noun: str, about: _Noun) -> Iterator[Command]:
    """Yield the commands that change records of a type."""
    defaults = {"yes": True, "needed": about.needed}
    yield Command(
        f"{noun} add",
        help=f"store {a(noun)}",
        examples=(f"{noun} add {about.new}", f"{noun} add --from robot.servolink.json {about.in_file}"),
        options=(
            option("what", "CAPTION", f"its caption, at most 32 bytes; or {_JSON}"),
            *(_action(f"{DEFAULT_SECONDS:g}") if noun == "action" else about.options),
            option("--id", "ID", "its id (the lowest free one)", RECORD_ID),
            _source("the record CAPTION, with all that it runs"),
        ),
        defaults=defaults,
        needs_records=True,
        run=late("stored.edit_records:run_add"),
    )
    yield Command(
        f"{noun} set",
        help=f"change {a(noun)}",
        examples=(f"{noun} set 1 {about.change}",),
        options=(
            _NAME,
            option("what", "RECORD", f"{_JSON}; what it leaves out stays", nargs="?"),
            *about.options,
            _source("the record RECORD, by caption or id"),
        ),
        defaults=defaults,
        needs_records=True,
        run=late("stored.edit_records:run_set"),
    )
    yield Command(
        f"{noun} rename",
        help=f"give {a(noun)} another caption",
        examples=(f"{noun} rename 1 Hello",),
        options=(_NAME, option("caption", "CAPTION", "the new caption, at most 32 bytes")),
        defaults=defaults,
        needs_records=True,
        run=late("stored.edit_records:run_rename"),
    )
    yield Command(
        f"{noun} delete",
        help=f"delete {NOUNS[noun]}, after a backup",
        examples=(f"{noun} delete {about.unused} --yes",),
        options=(
            option("record", "NAME", "captions or ids, as in the list", RECORD_NAME, nargs="+"),
            flag("--yes", "do not ask"),
        ),
        needs_records=True,
        run=late("stored.edit_records:run_delete"),
    )


TABLE_ACTIVATE = Command(
    "table activate",
    help="make a joystick table the one that buttons obey",
    examples=("table activate 1",),
    options=(_NAME,),
    needs_records=True,
    run=late("stored.edit_records:run_activate"),
)
COMMANDS = tuple(command for noun, about in _TYPES.items() for command in _commands(noun, about))
