"""The record that a command line describes: by options, as JSON, or by its name in a project file."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from msgspec.structs import replace

from servolink.cli.arguments import RECORD_ID, number, whole_number
from servolink.cli.main import usage_error
from servolink.cli.motion import servo_angle
from servolink.errors import EncodeError, ProjectError, ServolinkError
from servolink.files import read_file, reason
from servolink.json_text import MAX_SIZE, read_json
from servolink.project.model import Project
from servolink.project.records import find_servo
from servolink.protocol.json_form import record_from_json, record_to_json
from servolink.protocol.record_types import Record, RecordType
from servolink.protocol.records import Action, Button, JoystickTable, Macro, MacroCommand, MacroCommandType

Make: TypeAlias = Callable[[Any], Any]
"""Takes the record as it is stored, or an empty one, and returns it as it is to be."""

_SECONDS = 1.0
_PART = re.compile(r"(action|macro|wait):([0-9.]+)(?:x([0-9]+))?(?:@([0-9]+))?", re.ASCII)
_BUTTON = whole_number(0, 2**32 - 1)
_PRESSES = {"press": "button_press_macro", "long_press": "button_long_press_macro", "up": "button_up_macro"}
"""Option to field."""


def add_action_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that describe an action."""
    parser.set_defaults(from_options=_action, needed="--pose")
    parser.add_argument(
        "--pose",
        type=partial(_listed, servo_angle),
        metavar="SERVO=ANGLE,...",
        help="where servos go, as in 1=30,hip=-10",
    )
    parser.add_argument(
        "--seconds", type=number(0, 327.67, "seconds"), metavar="N", help=f"how long it takes, to 0.01 ({_SECONDS:g})"
    )


def add_macro_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that describe a macro."""
    parser.set_defaults(from_options=_macro, needed="--play")
    parser.add_argument(
        "--play",
        type=partial(_listed, _part),
        metavar="PART,...",
        help="one after the other: action:ID, macro:ID or wait:SECONDS; x3 repeats, @50 is half the speed",
    )


def add_table_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that describe a joystick table."""
    parser.set_defaults(from_options=_table, needed="--press, --long-press or --up")
    for option, when in ("press", "is pressed"), ("long-press", "is held down"), ("up", "is released"):
        parser.add_argument(
            f"--{option}",
            action="append",
            type=_assigned,
            metavar="BUTTON=MACRO",
            help=f"start a macro when a button {when}; 0 for none",
        )


def maker(args: argparse.Namespace, kind: RecordType[Any]) -> Make:
    """Return what makes the record that `args` describes. JSON is read at once, from standard input too."""
    given = [name for name in ("pose", "seconds", "play", *_PRESSES) if getattr(args, name, None) is not None]
    text = _json_text(args.what)
    if text is None:
        if not given or (given == ["seconds"] and args.verb == "add"):
            usage_error(args, f"say what it does: {args.needed}, JSON, or --from FILE")
        return partial(args.from_options, args)
    if given:
        usage_error(args, f"--{given[0].replace('_', '-')} and JSON are both given; choose one")
    fields = _fields(text)
    return lambda old: record_from_json(kind.record_class, {**record_to_json(old), **fields}, unchecked=True)


def _json_text(what: str | None) -> str | bytes | None:
    """Return the text of the JSON in `what`, or that it names; None for a caption."""
    if what == "-":
        return sys.stdin.buffer.read(MAX_SIZE + 1) if sys.stdin else b""
    if what and what.startswith("@"):
        try:
            return read_file(Path(what[1:]), MAX_SIZE)
        except (OSError, ValueError) as error:  # ValueError: NUL in the name
            raise ServolinkError(f"{what[1:]} cannot be read: {reason(error)}") from error
    return what if what and what.startswith("{") else None


def _fields(text: str | bytes) -> dict[str, Any]:
    try:
        fields = read_json(text.encode("utf-8", "surrogateescape") if isinstance(text, str) else text)
    except ValueError as error:
        raise EncodeError(f"the record {error}") from error
    if not isinstance(fields, dict):
        raise EncodeError("the record must be a JSON object")
    return fields


# --- options ----------------------------------------------------------------------------------------------------------


def _action(args: argparse.Namespace, old: Action) -> Action:
    if args.pose is None:
        interval = Action.pose("", {0: 0}, seconds=args.seconds).steps[0].interval
        return replace(old, steps=tuple(replace(step, interval=interval) for step in old.steps))
    angles = dict(args.pose)
    if len(angles) < len(args.pose):
        usage_error(args, "a servo is given twice")
    seconds = args.seconds if args.seconds is not None else old.seconds if old.steps else _SECONDS
    return replace(old, steps=Action.pose("", angles, seconds=seconds).steps)


def with_servo_ids(project: Project, record: Any) -> Any:
    """Return `record` with ids for the captions that `--pose` takes. Raise ProjectError for unknown ones."""
    if not isinstance(record, Action):
        return record
    servo_ids = [find_servo(project, step.servo_id) for step in record.steps]
    if any(isinstance(step.servo_id, str) for step in record.steps) and len({*servo_ids}) < len(servo_ids):
        raise ProjectError("a servo is given twice, by its caption and by its id")
    steps = zip(record.steps, servo_ids, strict=True)
    return replace(record, steps=tuple(replace(step, servo_id=servo_id) for step, servo_id in steps))


def _macro(args: argparse.Namespace, old: Macro) -> Macro:
    return replace(old, commands=tuple(args.play))


def _table(args: argparse.Namespace, old: JoystickTable) -> JoystickTable:
    buttons = {button.button_id: button for button in old.buttons}
    for option, field in _PRESSES.items():
        for button_id, macro_id in getattr(args, option) or ():
            button = buttons.get(button_id, Button(button_id))
            buttons[button_id] = replace(button, **{field: macro_id})
    return replace(old, buttons=tuple(buttons.values()))


def _listed(read: Callable[[str], Any], text: str) -> list[Any]:
    return [read(part) for part in text.split(",")]


def _part(text: str) -> MacroCommand:
    found = _PART.fullmatch(text)
    if found is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} must be action:ID, macro:ID or wait:SECONDS, with x3 to repeat it and @50 for half the speed"
        )
    word, value = found[1], found[2]
    loop = whole_number(0, 0x7FFF)(found[3] or "1")
    ratio = whole_number(1, 100)(found[4] or "100")
    if word == "wait":
        seconds = number(0, 2_147_483, "seconds")(value)
        return MacroCommand(round(seconds * 1000), MacroCommandType.DELAY.value, ratio, loop)
    kind = MacroCommandType.ACTION if word == "action" else MacroCommandType.MACRO
    return MacroCommand(RECORD_ID(value), kind.value, ratio, loop)


def _assigned(text: str) -> tuple[int, int]:
    button, _, macro = text.partition("=")
    return _BUTTON(button), whole_number(0, 2**31 - 1)(macro)


def empty(kind: RecordType[Any], caption: str, record_id: int) -> Record:
    """Return a record with nothing in it."""
    record: Record = kind.record_class(record_id, caption)
    return record
