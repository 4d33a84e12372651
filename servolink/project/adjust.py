"""Scaling of the durations of a project, and renaming of records and servos."""

from __future__ import annotations

from collections.abc import Collection

from msgspec.structs import replace

from servolink.errors import ProjectError, escape, quote
from servolink.project.model import Project, name_of
from servolink.project.record_lookup import MAX_INTERVAL, with_caption, with_records
from servolink.protocol import Action, Macro, MacroCommand, MacroCommandType, Record, RecordType, ServoParameter, Step
from servolink.support import as_number, is_number

_MAX_STEP = 0x7FFF
_MAX_FACTOR = 1e9  # already too long for any duration but 0


def scale_project(
    project: Project, factor: float, action_ids: Collection[int] | None = None
) -> tuple[Project, list[str]]:
    """Return `project` with durations multiplied by `factor`, and the list of changes; 2 halves the speed.

    A duration of 0 stays 0; any other duration becomes at least 10 ms.

    Args:
        project: Project to scale.
        factor: Factor above 0, up to 1e9.
        action_ids: Actions to scale; `fix_project` then corrects the durations of macros with these actions. If
            None, all actions and pauses are scaled.

    Raises:
        ProjectError: The factor is out of range, an action is missing, or a duration gets too long for the protocol.
    """
    factor = as_number(factor)
    if not is_number(factor) or not 0 < factor <= _MAX_FACTOR:
        raise ProjectError(f"the factor must be above 0 and at most {_MAX_FACTOR:,}, not {quote(factor)}")
    if missing := set(action_ids or ()) - {one.action_id for one in project.actions}:
        raise ProjectError(f"there is no action {min(missing)}")
    actions = [
        _scaled_action(one, factor) if action_ids is None or one.action_id in action_ids else one
        for one in project.actions
    ]
    macros = [_scaled_macro(one, factor) if action_ids is None else one for one in project.macros]
    pairs = zip((*project.actions, *project.macros), (*actions, *macros), strict=True)
    changes = [f"{name_of(before)}: durations multiplied by {factor:g}" for before, after in pairs if before != after]
    return replace(project, actions=tuple(actions), macros=tuple(macros)), changes


def _scaled_action(action: Action, factor: float) -> Action:
    steps = tuple(
        Step(step.servo_id, step.degree, _scaled(step.interval, factor, _MAX_STEP, 10, f"{name_of(action)}, step {at}"))
        for at, step in enumerate(action.steps, 1)
    )
    return replace(action, steps=steps)


def _scaled_macro(macro: Macro, factor: float) -> Macro:
    commands = tuple(
        _scaled_command(one, factor, f"{name_of(macro)}, command {at}") for at, one in enumerate(macro.commands, 1)
    )
    return replace(macro, commands=commands)


def _scaled_command(command: MacroCommand, factor: float, where: str) -> MacroCommand:
    total = _scaled(command.total_interval, factor, MAX_INTERVAL, 1, where)
    if command.type != MacroCommandType.DELAY:
        return replace(command, total_interval=total)
    delay = _scaled(command.command_id, factor, MAX_INTERVAL, 1, where)
    return replace(command, command_id=delay, total_interval=total)


def _scaled(units: int, factor: float, most: int, milliseconds: int, where: str) -> int:
    """Return `units`, of so many milliseconds each, times `factor`; a positive number stays at least 1."""
    if units <= 0:
        return units
    if units * factor > most:
        longest = f"the longest is {most * milliseconds / 1000:g} s"
        raise ProjectError(f"{where}: {units * milliseconds / 1000:g} s times {factor:g} is too long; {longest}")
    return max(1, round(units * factor))


def rename_record(project: Project, record: Record, caption: str) -> tuple[Project, list[str]]:
    """Return `project` with another caption for `record`, and the list of changes.

    Raise ProjectError if `project` has no record with the type and id of `record`, or a duplicate id.
    """
    kind = RecordType.of(record)
    records = project.by_type()
    shelf, record_id = records[kind.field], kind.id_of(record)
    if (before := shelf.get(record_id)) is None:
        raise ProjectError(f"there is no {kind} {record_id}")
    if kind.caption_of(before) == caption:
        return project, []
    shelf[record_id] = with_caption(before, caption)
    return with_records(project, records), [f"{name_of(before)} is now '{escape(caption)}'"]


def rename_servo(project: Project, servo_id: int, caption: str) -> tuple[Project, list[str]]:
    """Return `project` with a new caption for a servo, with or without a caption before, and the list of changes."""
    parameters = project.by_servo()
    before = parameters.get(servo_id, ServoParameter(servo_id))
    if before.servo_caption == caption:
        return project, []
    parameters[servo_id] = replace(before, servo_caption=caption)
    change = f"servo {servo_id} '{escape(before.servo_caption)}' is now '{escape(caption)}'"
    return replace(project, servo_parameters=tuple(parameters.values())), [change]
