"""`servolink actions`, `macros` and `tables`: what is stored on the board."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from difflib import SequenceMatcher
from typing import Any

from servolink.cli.main import OK
from servolink.cli.output import Table, print_json, print_table, print_text
from servolink.cli.session import Interruption, run_with_board
from servolink.client.board import Board
from servolink.project.model import is_unfinished
from servolink.project.transfer.results import Change
from servolink.protocol.records import Action, Button, JoystickTable, Macro, MacroCommand, ServoParameter, Step

_KINDS = {"actions": "action", "macros": "macro", "tables": "joystick table"}
_TYPES = {0: "action", 1: "delay", 2: "macro"}
_DELAY = 1


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `command`."""
    parser.set_defaults(run=run)
    parser.add_argument("id", nargs="?", type=record_id, metavar="ID", help="show this one whole")


def run(args: argparse.Namespace) -> int:
    """Print the list, or one record."""

    async def talk(board: Board, interruption: Interruption) -> int:
        if args.id is None:
            found = await _list(board, args.command)
            show = _show_list
        else:
            found = await _one(board, args.command, args.id)
            show = _show_one
        if args.json:
            print_json(found)
        else:
            show(args.command, found)
        return OK

    return run_with_board(args, talk)


def record_id(text: str) -> int:
    """Read the id of an action, a macro or a table."""
    if not (text.isascii() and text.isdecimal() and 0 < int(text) < 2**31):
        raise argparse.ArgumentTypeError(f"{text!r} is no id, 1 to {2**31 - 1}")
    return int(text)


async def _list(board: Board, command: str) -> dict[str, Any]:
    if command == "actions":
        actions = await board.actions()
        return {command: [{"action_id": one.action_id, "action_caption": one.action_caption} for one in actions]}
    if command == "macros":
        macros = await board.macros()
        return {command: [{"macro_id": one.macro_id, "macro_caption": one.macro_caption} for one in macros]}
    active = await board.active_joystick_table()
    tables = await board.joystick_tables()
    return {
        command: [
            {"table_id": one.table_id, "table_caption": one.table_caption, "is_active": one.table_id == active}
            for one in tables
        ]
    }


async def _one(board: Board, command: str, wanted: int) -> dict[str, Any]:
    if command == "actions":
        return described(await board.action(wanted))
    if command == "macros":
        return described(await board.macro(wanted))
    return described(await board.joystick_table(wanted))


def described(record: Action | Macro | JoystickTable) -> dict[str, Any]:
    """Return a record for programs, with times in seconds."""
    if isinstance(record, Action):
        return _action(record)
    return _macro(record) if isinstance(record, Macro) else _table(record)


def _action(action: Action) -> dict[str, Any]:
    steps = [
        {"servo_id": step.servo_id, "degree": step.degree, "interval_seconds": step.interval / 100}
        for step in action.steps
    ]
    return {"action_id": action.action_id, "action_caption": action.action_caption, "steps": steps}


def _macro(macro: Macro) -> dict[str, Any]:
    commands = [_command(command) for command in macro.commands]
    return {"macro_id": macro.macro_id, "macro_caption": macro.macro_caption, "commands": commands}


def _command(command: MacroCommand) -> dict[str, Any]:
    what = (
        {"delay_seconds": command.command_id / 1000} if command.type == _DELAY else {"command_id": command.command_id}
    )
    return {
        "type": _TYPES.get(command.type, command.type),
        **what,
        "ratio_percent": command.ratio,
        "loop": command.loop,
        "total_interval_seconds": command.total_interval / 1000,
    }


def _table(table: JoystickTable) -> dict[str, Any]:
    buttons = [
        {
            "button_id": button.button_id,
            "button_caption": button.button_caption,
            "button_press_macro": button.button_press_macro or None,
            "button_long_press_macro": button.button_long_press_macro or None,
            "button_up_macro": button.button_up_macro or None,
            "uninterruptible": bool(button.uninterruptible),
        }
        for button in table.buttons
    ]
    return {"table_id": table.table_id, "table_caption": table.table_caption, "buttons": buttons}


def _show_list(command: str, found: dict[str, Any]) -> None:
    records = found[command]
    if not records:
        print_text(f"no {_KINDS[command]} is stored on the board")
        return
    columns = [_KINDS[command], "caption", *(["active"] if command == "tables" else [])]
    print_table(Table(columns, [tuple(record.values()) for record in records]))


def _show_one(command: str, found: dict[str, Any]) -> None:
    print_table(whole_table(command, found))


def whole_table(command: str, record: dict[str, Any]) -> Table:
    """Return what `described` says of one of the `actions`, `macros` or `tables`, as a table for people."""
    number, caption, records = record.values()
    rows = [tuple(_as_row(record)) for record in records]
    return Table(_COLUMNS[command], rows, f"{_KINDS[command]} {number} '{caption}'")


_COLUMNS = {
    "actions": ("servo", "angle", "seconds"),
    "macros": ("does", "speed %", "times", "whole seconds"),
    "tables": ("button", "caption", "press macro", "long press macro", "up macro", "uninterruptible"),
}


def _as_row(record: dict[str, Any]) -> Iterable[object]:
    """Return a step, a command or a button as the cells of its row."""
    if "type" not in record:
        return record.values()
    does = (
        f"wait {record['delay_seconds']:g} s"
        if "delay_seconds" in record
        else f"{record['type']} {record['command_id']}"
    )
    return does, record["ratio_percent"], record["loop"], record["total_interval_seconds"]


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
            return [_command_words(command) for command in record.commands]
        case JoystickTable():
            return [_button(button) for button in record.buttons]
        case _:
            return [f"corrected by {record.adjusted_degree}°"]


def _step(step: Step) -> str:
    return f"servo {step.servo_id} to {step.degree} in {step.interval / 100:g} s"


def _command_words(command: MacroCommand) -> str:
    does = _DOES.get(command.type, f"type {command.type} {{}}").format(command.command_id)
    return f"{does}, {command.ratio} % speed, {command.loop} times, {command.total_interval} ms in all"


def _button(button: Button) -> str:
    macros = (button.button_press_macro, button.button_long_press_macro, button.button_up_macro)
    press, long_press, up = (macro or "none" for macro in macros)
    ends = ", uninterruptible" if button.uninterruptible else ""
    return f"button {button.button_id} '{button.button_caption}': press {press}, long press {long_press}, up {up}{ends}"
