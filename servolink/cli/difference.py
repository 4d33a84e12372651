"""What differs between two projects, as people read it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher
from typing import Any

from servolink.cli.output import print_text
from servolink.project.imports.journal import is_unfinished
from servolink.project.imports.results import Change
from servolink.protocol.editing import Action, Macro, MacroCommand, ServoParameter
from servolink.protocol.joystick import Button, JoystickTable
from servolink.protocol.servos import Step

_STYLES = {"+": "green", "-": "red", "~": "yellow"}
_COMPARED = 1_000_000
"""Pairs of lines; comparing more takes seconds."""
_DOES = {0: "action {}", 1: "wait {} ms", 2: "macro {}"}


def print_changes(changes: Sequence[Change]) -> None:
    """Print all changes, a line or more for each."""
    for change in changes:
        for line in lines_of(change):
            print_text(line, _STYLES.get(line.strip()[:1], ""))


def kind_of(change: Change) -> str:
    """Return "added", "removed" or "changed"."""
    return "added" if change.old is None else "removed" if change.new is None else "changed"


def lines_of(change: Change) -> Iterator[str]:
    """Yield `+ action 3 'Wave': 2 steps`, and for a change what differs inside, line by line."""
    if change.old is None:
        yield f"+ {change.what}{_summary(change.new)}"
    elif change.new is None:
        yield f"- {change.what}{_summary(change.old)}"
    elif isinstance(change.new, int):
        yield f"~ {change.what}: {_number(change.old)} -> {_number(change.new)}"
    else:
        yield f"~ {change.what} '{_caption(change.new)}'"
        if _caption(change.old) != _caption(change.new):
            yield f"    caption '{_caption(change.old)}' -> '{_caption(change.new)}'"
        yield from _inside(_items(change.old), _items(change.new))


def _inside(old: list[str], new: list[str]) -> Iterator[str]:
    """Yield the lines that go and come; of long lists without much in common all of them."""
    begin = _alike(old, new)
    end = _alike(old[begin:][::-1], new[begin:][::-1])
    old, new = old[begin : len(old) - end], new[begin : len(new) - end]
    pairs = len(old) * len(new)
    whole = [("replace", 0, len(old), 0, len(new))]
    codes = SequenceMatcher(None, old, new, autojunk=False).get_opcodes() if pairs <= _COMPARED else whole
    for tag, low, high, first, last in codes:
        if tag != "equal":
            yield from (f"    - {item}" for item in old[low:high])
            yield from (f"    + {item}" for item in new[first:last])


def _alike(old: list[str], new: list[str]) -> int:
    """Return how many items both begin with."""
    pairs = enumerate(zip(old, new, strict=False))
    return next((at for at, (before, after) in pairs if before != after), min(len(old), len(new)))


def _caption(record: Any) -> str:
    return (
        record.servo_caption
        if isinstance(record, ServoParameter)
        else str(getattr(record, record.__struct_fields__[1]))
    )


def _summary(value: Any) -> str:
    match value:
        case Action():
            seconds = max((step.interval for step in value.steps), default=0) / 100
            return f" '{value.action_caption}': {_count(value.steps, 'step')}, {seconds:g} s"
        case Macro():
            return f" '{value.macro_caption}': {_count(value.commands, 'command')}"
        case JoystickTable():
            return f" '{value.table_caption}': {_count(value.buttons, 'button')}"
        case ServoParameter():
            return f" '{value.servo_caption}': corrected by {value.adjusted_degree}°"
        case _:
            return f": {_number(value)}"


def _number(value: int) -> str:
    """Return an id; the project id of a board in the middle of an import is none."""
    return "an unfinished import" if is_unfinished(value) else str(value)


def _count(items: Sequence[object], word: str) -> str:
    return f"{len(items)} {word}{'' if len(items) == 1 else 's'}"


def _items(record: Any) -> list[str]:
    """Return the parts of a record, each in words that tell it from every other."""
    match record:
        case Action():
            return [f"step {at}: {_step(step)}" for at, step in enumerate(record.steps, 1)]
        case Macro():
            return [_command(command) for command in record.commands]
        case JoystickTable():
            return [_button(button) for button in record.buttons]
        case _:
            return [f"corrected by {record.adjusted_degree}°"]


def _step(step: Step) -> str:
    return f"servo {step.servo_id} to {step.degree} in {step.interval / 100:g} s"


def _command(command: MacroCommand) -> str:
    does = _DOES.get(command.type, f"type {command.type} {{}}").format(command.command_id)
    return f"{does}, {command.ratio} % speed, {command.loop} times, {command.total_interval} ms in all"


def _button(button: Button) -> str:
    macros = (button.button_press_macro, button.button_long_press_macro, button.button_up_macro)
    press, long_press, up = (macro or "none" for macro in macros)
    ends = ", uninterruptible" if button.uninterruptible else ""
    return f"button {button.button_id} '{button.button_caption}': press {press}, long press {long_press}, up {up}{ends}"
