"""`servolink project show`: what is in a project."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from servolink.cli.main import OK
from servolink.cli.output import Table, print_json, print_table, print_text
from servolink.cli.project.source import add_source, with_project
from servolink.cli.records import described, whole_table
from servolink.project.model import Project
from servolink.project.records import durations, find, total_size
from servolink.protocol.record_types import ACTION, MACRO, RECORD_TYPES, TABLE, RecordType
from servolink.protocol.records import Action, MacroCommand

_COMMANDS = {ACTION.field: "actions", MACRO.field: "macros", TABLE.field: "tables"}
_ACTION, _DELAY, _MACRO = 0, 1, 2
_CALLED = {_ACTION: "action", _MACRO: "macro"}


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink project show`."""
    parser.set_defaults(run=run)
    add_source(parser)
    parser.add_argument(
        "records", nargs="*", default=[], metavar="NAME", help="show these whole: caption or id, or as in action:3"
    )


def run(args: argparse.Namespace) -> int:
    """Print the project, or some records of it."""

    def show(project: Project) -> int:
        records = [find(project, name, RECORD_TYPES) for name in args.records]
        if args.json:
            print_json(_records(records) if records else _project(project))
        elif records:
            for record in records:
                print_table(whole_table(_COMMANDS[_kind(record).field], described(record)))
        else:
            _print(project)
        return OK

    return with_project(args, show)


def _kind(record: Any) -> RecordType[Any]:
    return next(kind for kind in RECORD_TYPES if isinstance(record, kind.record_class))


def _records(records: Sequence[Any]) -> dict[str, Any]:
    return {kind.field: [described(one) for one in records if _kind(one) is kind] for kind in RECORD_TYPES}


def _project(project: Project) -> dict[str, Any]:
    """Return all of a project for programs."""
    seconds = _macro_seconds(project)
    return {
        "project_id": project.project_id or None,
        "stored_bytes": total_size(project),
        "servo_parameters": [
            {"servo_id": one.servo_id, "servo_caption": one.servo_caption, "adjusted_degree": one.adjusted_degree}
            for one in project.servo_parameters
        ],
        "actions": [{**described(one), "duration_seconds": _action_seconds(one)} for one in project.actions],
        "macros": [{**described(one), "duration_seconds": seconds[one.macro_id]} for one in project.macros],
        "joystick_tables": [described(one) for one in project.joystick_tables],
        "active_joystick_table": project.active_joystick_table,
    }


def _print(project: Project) -> None:
    facts = [
        ("project id", project.project_id or "none"),
        ("size", f"{total_size(project):,} bytes on a board"),
        ("joystick table", project.active_joystick_table or "whichever the board takes"),
    ]
    print_table(Table((), facts))
    for table in _tables(project):
        if table.rows:
            print_text("")
            print_table(table)


def _tables(project: Project) -> Iterator[Table]:
    """Yield the tables for people, empty ones too."""
    parameters = [(one.servo_id, one.servo_caption, one.adjusted_degree) for one in project.servo_parameters]
    yield Table(("servo", "caption", "correction"), parameters)
    actions = [(one.action_id, one.action_caption, _action_seconds(one), _pose(one)) for one in project.actions]
    yield Table(("action", "caption", "seconds", "angles"), actions)
    seconds, captions = _macro_seconds(project), _captions(project)
    macros = [
        (
            one.macro_id,
            one.macro_caption,
            seconds[one.macro_id],
            ", ".join(_does(command, captions) for command in one.commands),
        )
        for one in project.macros
    ]
    yield Table(("macro", "caption", "seconds", "does"), macros)
    yield Table(
        ("table", "caption", "button", "caption", "press", "long press", "up"), list(_buttons(project, captions))
    )


def _action_seconds(action: Action) -> float:
    return max((step.interval for step in action.steps), default=0) / 100


def _macro_seconds(project: Project) -> dict[int, float | None]:
    """Return how long each macro takes; None if it never ends, or calls what is not there."""
    return {
        macro_id: None if None in each else sum(time or 0 for time in each) / 1000
        for macro_id, each in durations(project).items()
    }


def _pose(action: Action) -> str:
    """Return the angles by servo, with the time of those that take less than the action."""
    whole = max((step.interval for step in action.steps), default=0)
    return ", ".join(
        f"{step.servo_id}: {step.degree}" + (f" in {step.interval / 100:g} s" if step.interval != whole else "")
        for step in action.steps
    )


def _captions(project: Project) -> Mapping[tuple[int, int], str]:
    """Return the captions of what commands call, by the command's type and id."""
    actions = {(_ACTION, one.action_id): one.action_caption for one in project.actions}
    return actions | {(_MACRO, one.macro_id): one.macro_caption for one in project.macros}


def _does(command: MacroCommand, captions: Mapping[tuple[int, int], str]) -> str:
    if command.type == _DELAY:
        does = f"wait {command.command_id / 1000:g} s"
    else:
        word = _CALLED.get(command.type, f"command of type {command.type}:")
        does = captions.get((command.type, command.command_id)) or f"{word} {command.command_id}"
    times_over = f" {command.loop} times" if command.loop != 1 else ""
    return does + times_over + (f" at {command.ratio} %" if command.ratio != 100 else "")


def _buttons(project: Project, captions: Mapping[tuple[int, int], str]) -> Iterator[tuple[object, ...]]:
    """Yield a row for each button, with what the macros are called; a table without any has a row as well."""

    def macro(macro_id: int) -> str:
        return captions.get((_MACRO, macro_id)) or f"macro {macro_id}" if macro_id else ""

    for table in project.joystick_tables:
        if not table.buttons:
            yield table.table_id, table.table_caption, None, None, None, None, None
        for one in table.buttons:
            started = (one.button_press_macro, one.button_long_press_macro, one.button_up_macro)
            yield table.table_id, table.table_caption, one.button_id, one.button_caption, *map(macro, started)
