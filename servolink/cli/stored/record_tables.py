"""Stored records for people: as tables, and differences between two records."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from typing import Any

from servolink.cli.screen.output import Table
from servolink.cli.screen.result import Part
from servolink.project import UNFINISHED, Change, caption_of, described, name_of
from servolink.protocol import (
    ACTION,
    MACRO,
    TABLE,
    Action,
    Button,
    Macro,
    MacroCommand,
    MacroCommandType,
    RecordType,
    ServoParameter,
    Step,
)

_COLUMNS = {
    ACTION: ("servo", "angle", "seconds"),
    MACRO: ("does", "speed %", "times", "seconds in all"),
    TABLE: ("button", "caption", "press macro", "long press macro", "up macro", "uninterruptible"),
}


def record_table(record: Action | Macro | Any) -> Table:
    """Return a record as a table for people, with one row for each part."""
    kind = RecordType.of(record)
    return Table(_COLUMNS[kind], [_row(part) for part in kind.parts_of(record)], name_of(record))


def _row(part: Step | MacroCommand | Button) -> tuple[object, ...]:
    match part:
        case Step():
            return part.servo_id, part.degree, part.seconds
        case MacroCommand():
            return command_text(part), part.ratio, part.loop, part.total_interval / 1000
        case Button():
            macros = (part.button_press_macro, part.button_long_press_macro, part.button_up_macro)
            return part.button_id, part.button_caption, *(one or None for one in macros), bool(part.uninterruptible)


def command_text(command: MacroCommand, captions: Mapping[tuple[str, int], str] | None = None) -> str:
    """Return the effect of a macro command: `wait 0.3 s`, or the record to run, by caption where `captions` has the id.

    `captions` are by label of the type and id of the record.
    """
    if command.type == MacroCommandType.DELAY:
        return f"wait {command.command_id / 1000:g} s"
    for _, kind in MACRO.links(command):
        return (captions or {}).get((kind.label, command.command_id)) or f"{kind} {command.command_id}"
    return f"command of type {int(command.type)}: {command.command_id}"


_STYLES = {"+": "green", "-": "red", "~": "yellow"}
_MOST_COMPARED = 1_000_000
"""The most pairs of lines to compare; more take seconds."""


def changes_text(changes: Sequence[Change]) -> Iterator[Part]:
    """Yield changes, each as separate lines."""
    for change in changes:
        yield from ((line, _STYLES.get(line.strip()[:1], "")) for line in lines_of(change))


def change_word(change: Change) -> str:
    """Return "added", "removed" or "changed"."""
    return "added" if change.old is None else "removed" if change.new is None else "changed"


def lines_of(change: Change) -> Iterator[str]:
    """Yield `+ action 3 'Wave': 2 steps, 0.5 s`; for a changed record also each part that differs."""
    if change.old is None:
        yield f"+ {change.what}{_summary(change.new)}"
    elif change.new is None:
        yield f"- {change.what}{_summary(change.old)}"
    elif isinstance(change.new, int):
        yield f"~ {change.what}: {_id_text(change.old)} -> {_id_text(change.new)}"
    else:
        old, new = caption_of(change.old), caption_of(change.new)
        yield f"~ {change.what} '{new}'"
        if old != new:
            yield f"    caption '{old}' -> '{new}'"
        yield from _differences(_part_texts(change.old), _part_texts(change.new))


def _differences(old: list[str], new: list[str]) -> Iterator[str]:
    """Yield the lines that go and come, or all lines if the lists are long and have little in common."""
    begin = _common_prefix(old, new)
    end = _common_prefix(old[begin:][::-1], new[begin:][::-1])
    old, new = old[begin : len(old) - end], new[begin : len(new) - end]
    codes = [("replace", 0, len(old), 0, len(new))]
    if len(old) * len(new) <= _MOST_COMPARED:
        codes = list(SequenceMatcher(None, old, new, autojunk=False).get_opcodes())
    for tag, low, high, first, last in codes:
        if tag != "equal":
            yield from (f"    - {item}" for item in old[low:high])
            yield from (f"    + {item}" for item in new[first:last])


def _common_prefix(old: list[str], new: list[str]) -> int:
    """Return the number of equal lines at the start of both lists."""
    pairs = enumerate(zip(old, new, strict=False))
    return next((at for at, (before, after) in pairs if before != after), min(len(old), len(new)))


def _summary(value: Any) -> str:
    """Return caption and size of a record, or the id."""
    if isinstance(value, int):
        return f": {_id_text(value)}"
    return f" {described(value)}"


def _id_text(value: int) -> str:
    """Return an id; during an import the project id is none."""
    return "an unfinished import" if value in UNFINISHED else str(value)


def _part_texts(stored: Any) -> list[str]:
    """Return a text for each part of a record, different for different parts."""
    if isinstance(stored, ServoParameter):
        return [f"corrected by {stored.adjusted_degree}°"]
    return [_part_text(at, part) for at, part in enumerate(RecordType.of(stored).parts_of(stored), 1)]


def _part_text(at: int, part: Step | MacroCommand | Button) -> str:
    """Return a step, a macro command or a button as a sentence."""
    match part:
        case Step():
            return f"step {at}: servo {part.servo_id} to {part.degree} in {part.seconds:g} s"
        case MacroCommand():
            times = "once" if part.loop == 1 else f"{part.loop} times"
            return f"{command_text(part)}, {part.ratio} % speed, {times}, {part.total_interval / 1000:g} s in all"
        case Button():
            macros = (part.button_press_macro, part.button_long_press_macro, part.button_up_macro)
            press, long_press, up = (macro or "none" for macro in macros)
            ending = ", uninterruptible" if part.uninterruptible else ""
            starts = f"press {press}, long press {long_press}, up {up}"
            return f"button {part.button_id} '{part.button_caption}': {starts}{ending}"
