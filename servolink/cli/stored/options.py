"""The options of `add`, `set`, `rename` and `delete`; what runs them is imported only when they run."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from servolink.cli.arguments import RECORD_ID, RECORD_NAME, file_path, number, or_caption, whole_number
from servolink.cli.commands import late
from servolink.cli.motion.move import servo_angle

DEFAULT_SECONDS = 1.0
"""Of an action, if none are given."""

_WHAT = r"(?:(action|macro|wait):|(?=name:)|(?![^:]*:))(.+?)"  # a colon after another word is a typing error
_PART = re.compile(rf"{_WHAT}(?:x([0-9]+))?(?:@([0-9]+))?", re.ASCII | re.DOTALL)
_BUTTON = whole_number(0, 2**32 - 1)
_MACRO_OR_NONE = or_caption(whole_number(0, 2**31 - 1))
_JSON = "a record as JSON, which begins with {, or @FILE or - (standard input) with it"


def _add_add(parser: argparse.ArgumentParser, add_options: Callable[[argparse.ArgumentParser], None]) -> None:
    parser.set_defaults(run=late("stored.edit:run_add"), yes=True)
    parser.add_argument("what", metavar="CAPTION", help=f"its caption, at most 32 bytes; or {_JSON}")
    add_options(parser)
    parser.add_argument("--id", type=RECORD_ID, metavar="ID", help="its id (the lowest free one)")
    _add_source(parser, "the record CAPTION of this project file, with all that it runs")


def _add_set(parser: argparse.ArgumentParser, add_options: Callable[[argparse.ArgumentParser], None]) -> None:
    parser.set_defaults(run=late("stored.edit:run_set"), yes=True)
    _add_id(parser)
    parser.add_argument("what", nargs="?", metavar="RECORD", help=f"{_JSON}; what it leaves out stays")
    add_options(parser)
    _add_source(parser, "the record RECORD, by caption or id, of this project file")


def _add_source(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("--from", dest="source", type=file_path, metavar="FILE", help=f"take {what}")


def _add_id(parser: argparse.ArgumentParser, **options: Any) -> None:
    parser.add_argument("record", type=RECORD_NAME, metavar="NAME", help="its caption or id, as in the list", **options)


def configure_add_action(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink action add`."""
    _add_add(parser, _add_action)


def configure_add_macro(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink macro add`."""
    _add_add(parser, _add_macro)


def configure_add_table(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink table add`."""
    _add_add(parser, _add_table)


def configure_set_action(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink action set`."""
    _add_set(parser, partial(_add_action, seconds="as before"))


def configure_set_macro(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink macro set`."""
    _add_set(parser, _add_macro)


def configure_set_table(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink table set`."""
    _add_set(parser, _add_table)


def configure_rename(parser: argparse.ArgumentParser) -> None:
    """Add the options of `rename`."""
    parser.set_defaults(run=late("stored.edit:run_rename"), yes=True)
    _add_id(parser)
    parser.add_argument("caption", metavar="CAPTION", help="the new caption, at most 32 bytes")


def configure_delete(parser: argparse.ArgumentParser) -> None:
    """Add the options of `delete`."""
    parser.set_defaults(run=late("stored.edit:run_delete"))
    _add_id(parser, nargs="+")
    parser.add_argument("--yes", action="store_true", help="do not ask")


def configure_activate(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink table activate`."""
    parser.set_defaults(run=late("stored.edit:run_activate"))
    _add_id(parser)


# --- what a record does -----------------------------------------------------------------------------------------------


class Part(NamedTuple):
    """A part of a macro, as it is typed."""

    word: str
    """`action`, `macro`, `wait`, or empty for a caption of an action or a macro."""
    value: int | str
    """Id or caption; for `wait` milliseconds."""
    loop: int
    ratio: int


def _add_action(parser: argparse.ArgumentParser, seconds: str = f"{DEFAULT_SECONDS:g}") -> None:
    """Add the options that describe an action; it takes `seconds` unless another duration is given."""
    parser.set_defaults(needed="--pose")
    parser.add_argument(
        "--pose",
        type=partial(_listed, servo_angle),
        metavar="SERVO=ANGLE,...",
        help="where servos go, as in 1=30,hip=-10 or all=0",
    )
    parser.add_argument(
        "--seconds",
        type=number(0, 327.67, "seconds"),
        metavar="N",
        help=f"duration in steps of 0.01 s ({seconds})",
    )


def _add_macro(parser: argparse.ArgumentParser) -> None:
    """Add the options that describe a macro."""
    parser.set_defaults(needed="--play")
    parser.add_argument(
        "--play",
        type=partial(_listed, _part),
        metavar="PART,...",
        help="one after the other: CAPTION, action:NAME, macro:NAME or wait:SECONDS; x3 repeats, @50 is half the speed",
    )


def _add_table(parser: argparse.ArgumentParser) -> None:
    """Add the options that describe a joystick table."""
    parser.set_defaults(needed="--press, --long-press or --up")
    for option, when in ("press", "is pressed"), ("long-press", "is held down"), ("up", "is released"):
        parser.add_argument(
            f"--{option}",
            action="append",
            type=_assigned,
            metavar="BUTTON=MACRO",
            help=f"start a macro, by caption or id, when a button {when}; 0: none",
        )


def _listed(read: Callable[[str], Any], text: str) -> list[Any]:
    return [read(part) for part in text.split(",")]


def _part(text: str) -> Part:
    found = _PART.fullmatch(text)
    if found is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} must be CAPTION, action:NAME, macro:NAME or wait:SECONDS, with x3 to repeat it and @50 for half "
            "the speed"
        )
    word, value = found[1] or "", found[2]
    loop = whole_number(0, 0x7FFF)(found[3] or "1")
    ratio = whole_number(1, 100)(found[4] or "100")
    if word == "wait":
        return Part(word, round(number(0, 2_147_483, "seconds")(value) * 1000), loop, ratio)
    name = RECORD_NAME(value)
    if not word and isinstance(name, int):
        raise argparse.ArgumentTypeError(f"{text!r} must say of what it is the id, as in action:{name} or macro:{name}")
    return Part(word, name, loop, ratio)


def _assigned(text: str) -> tuple[int, int | str]:
    button, equals, macro = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{text!r} must be BUTTON=MACRO, such as 7=1")
    return _BUTTON(button), _MACRO_OR_NONE(macro)
