"""Faster and slower."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import msgspec

from servolink.errors import ProjectError
from servolink.escaping import escape, quote
from servolink.project.model import Project
from servolink.project.records import by_kind, by_servo, named, with_records
from servolink.protocol.record_types import RecordType
from servolink.protocol.records import Action, Macro, MacroCommand, ServoParameter, Step

_LONGEST_STEP = 0x7FFF
_LONGEST = 0x7FFF_FFFF
_LARGEST = 1e9  # as a factor; with more nothing that takes time is short enough
_DELAY = 1


def scale_project(
    project: Project, factor: float, action_ids: Collection[int] | None = None
) -> tuple[Project, list[str]]:
    """Return `project` with its times multiplied by `factor`, and what was changed; 2 makes it half as fast.

    With `action_ids` only the times of these actions; else those of all actions, and the pauses and other times of
    macros. What takes no time still takes none, and all else takes 10 ms at least. The macros that call an action are
    as they were: `fix_project` makes their times right. ProjectError for a factor or an action that cannot be used.
    """
    if isinstance(factor, bool) or not isinstance(factor, (int, float)) or not 0 < factor <= _LARGEST:
        raise ProjectError(f"the factor {quote(factor)} is not above 0 and at most {_LARGEST:,}")
    if missing := set(action_ids or ()) - {one.action_id for one in project.actions}:
        raise ProjectError(f"there is no action {min(missing)}")
    said: list[str] = []

    def noted(before: Any, after: Any) -> Any:
        if before != after:
            said.append(f"{named(before)}: its times multiplied by {factor:g}")
        return after

    actions = [
        one if action_ids is not None and one.action_id not in action_ids else noted(one, _action(one, factor))
        for one in project.actions
    ]
    macros = project.macros if action_ids is not None else [noted(one, _macro(one, factor)) for one in project.macros]
    return msgspec.structs.replace(project, actions=tuple(actions), macros=tuple(macros)), said


def _action(action: Action, factor: float) -> Action:
    steps = tuple(
        Step(step.servo_id, step.degree, _time(step.interval, factor, _LONGEST_STEP, f"{named(action)}, step {at}", 10))
        for at, step in enumerate(action.steps, 1)
    )
    return msgspec.structs.replace(action, steps=steps)


def _macro(macro: Macro, factor: float) -> Macro:
    return msgspec.structs.replace(
        macro,
        commands=tuple(
            _command(one, factor, f"{named(macro)}, command {at}") for at, one in enumerate(macro.commands, 1)
        ),
    )


def _command(command: MacroCommand, factor: float, where: str) -> MacroCommand:
    whole = _time(command.total_interval, factor, _LONGEST, where, 1)
    if command.type != _DELAY:
        return msgspec.structs.replace(command, total_interval=whole)
    pause = _time(command.command_id, factor, _LONGEST, where, 1)
    return msgspec.structs.replace(command, command_id=pause, total_interval=whole)


def _time(units: int, factor: float, most: int, where: str, milliseconds: int) -> int:
    """Return so many units of `milliseconds` multiplied, whole, and at least one if it was any."""
    if units <= 0:
        return units
    if units * factor > most:
        longest = f"the longest is {most * milliseconds / 1000:g} s"
        raise ProjectError(f"{where}: {units * milliseconds / 1000:g} s times {factor:g} is too long; {longest}")
    return max(1, round(units * factor))


def rename_record(project: Project, kind: RecordType[Any], record_id: int, caption: str) -> tuple[Project, list[str]]:
    """Return `project` with another caption for a record, and what was changed; ProjectError if there is none."""
    records = by_kind(project)
    shelf = records[kind.field]
    if (record := shelf.get(record_id)) is None:
        raise ProjectError(f"there is no {kind.label} {record_id}")
    if kind.caption_of(record) == caption:
        return project, []
    shelf[record_id] = msgspec.structs.replace(record, **{record.__struct_fields__[1]: caption})
    return with_records(project, records), [f"{named(record)} is now '{escape(caption)}'"]


def rename_servo(project: Project, servo_id: int, caption: str) -> tuple[Project, list[str]]:
    """Return `project` with another caption for a servo, which it need not have had, and what was changed."""
    parameters = by_servo(project)
    before = parameters.get(servo_id, ServoParameter(servo_id))
    if before.servo_caption == caption:
        return project, []
    parameters[servo_id] = msgspec.structs.replace(before, servo_caption=caption)
    said = f"servo {servo_id} '{escape(before.servo_caption)}' is now '{escape(caption)}'"
    return msgspec.structs.replace(project, servo_parameters=tuple(parameters.values())), [said]
