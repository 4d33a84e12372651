"""`servolink project show`: show what is in a project."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from typing import Any

from servolink.cli.command import Command, option
from servolink.cli.projects.source import SOURCE, with_project
from servolink.cli.screen.output import Table
from servolink.cli.screen.result import Ending, Part, Returned
from servolink.cli.stored.record_tables import command_text, record_table
from servolink.project import Project, macro_seconds
from servolink.protocol import ACTION, MACRO, RECORD_TYPES, Action, MacroCommand, RecordType, record_to_json


@Command(
    "project show",
    help="show what a project contains",
    examples=("project show robot.servolink.json", "project show robot.servolink.json Bow"),
    options=(
        *SOURCE,
        option("records", "NAME", "show these in full: captions, ids, or as in action:3", nargs="*", default=[]),
    ),
    takes_board=False,
)
def run(args: argparse.Namespace) -> Ending:
    """Return the project, or some records of it."""

    def shown(project: Project) -> Returned:
        if records := [project.find(name, RECORD_TYPES) for name in args.records]:
            return Returned(_records_to_json(records), map(record_table, records))
        return Returned(_to_json(project), _text(project))

    return with_project(args, shown)


def _records_to_json(records: list[Any]) -> dict[str, Any]:
    return {kind.field: [record_to_json(one) for one in records if RecordType.of(one) is kind] for kind in RECORD_TYPES}


def _to_json(project: Project) -> dict[str, Any]:
    """Return the project in the form of a project file, with the size and the durations by id."""
    durations = {
        ACTION.field: {one.action_id: one.seconds for one in project.actions},
        MACRO.field: macro_seconds(project),
    }
    form: dict[str, Any] = record_to_json(project)
    return form | {"stored_bytes": project.total_size(), "duration_seconds": durations}


def _text(project: Project) -> Iterator[Part]:
    facts = [
        ("project id", project.project_id or "none"),
        ("size", f"{project.total_size():,} bytes on a board"),
        ("joystick table", project.active_joystick_table or "chosen by the board"),
    ]
    yield Table((), facts)
    for table in _tables(project):
        if table.rows:
            yield from ("", table)


def _tables(project: Project) -> Iterator[Table]:
    """Yield one table for each type of record, empty ones too."""
    parameters = [(one.servo_id, one.servo_caption, one.adjusted_degree) for one in project.servo_parameters]
    yield Table(("servo", "caption", "correction"), parameters)
    actions = [(one.action_id, one.action_caption, one.seconds, _pose_text(one)) for one in project.actions]
    yield Table(("action", "caption", "seconds", "angles"), actions)
    seconds = macro_seconds(project)
    captions = {(kind.label, kind.id_of(one)): kind.caption_of(one) for kind, one in _runnable(project)}
    macros = [
        (
            one.macro_id,
            one.macro_caption,
            seconds[one.macro_id],
            ", ".join(_with_ratio(command, captions) for command in one.commands),
        )
        for one in project.macros
    ]
    yield Table(("macro", "caption", "seconds", "does"), macros)
    buttons = list(_buttons(project, captions))
    yield Table(("table", "caption", "button", "caption", "press", "long press", "up"), buttons)


def _runnable(project: Project) -> Iterator[tuple[Any, Any]]:
    yield from ((ACTION, one) for one in project.actions)
    yield from ((MACRO, one) for one in project.macros)


def _pose_text(action: Action) -> str:
    """Return the angles by servo, with the durations shorter than the whole action."""
    return ", ".join(
        f"{step.servo_id}: {step.degree}" + (f" in {step.seconds:g} s" if step.seconds != action.seconds else "")
        for step in action.steps
    )


def _with_ratio(command: MacroCommand, captions: Mapping[tuple[str, int], str]) -> str:
    times = f" {command.loop} times" if command.loop != 1 else ""
    return command_text(command, captions) + times + (f" at {command.ratio} %" if command.ratio != 100 else "")


def _buttons(project: Project, captions: Mapping[tuple[str, int], str]) -> Iterator[tuple[object, ...]]:
    """Yield a row for each button, with the captions of its macros, and a row for each table without buttons."""

    def macro(macro_id: int) -> str:
        return captions.get((MACRO.label, macro_id)) or f"macro {macro_id}" if macro_id else ""

    for table in project.joystick_tables:
        if not table.buttons:
            yield table.table_id, table.table_caption, None, None, None, None, None
        for one in table.buttons:
            macros = (one.button_press_macro, one.button_long_press_macro, one.button_up_macro)
            yield table.table_id, table.table_caption, one.button_id, one.button_caption, *map(macro, macros)
