"""Build projects from parts that refer to each other by object."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any, TypeAlias

import msgspec

from servolink.errors import ProjectError
from servolink.project.model import Project
from servolink.project.records import by_kind, by_servo, durations, free_id, named, with_id, with_records
from servolink.project.validate import validate_project
from servolink.protocol.record_types import RecordType, type_of
from servolink.protocol.records import Action, JoystickTable, Macro, RecordRef, ServoParameter

Part: TypeAlias = Action | Macro | JoystickTable | ServoParameter

_DEEPEST = 100
"""Macros that call macros; what can be played nests less deep."""


def build_project(
    *parts: Part,
    project_id: int = 0,
    captions: Mapping[int, str] | None = None,
    active: JoystickTable | None = None,
) -> Project:
    """Return the project of `parts` and of all records that they refer to.

    A record without an id gets the lowest free one, in the order in which records are first met. `captions` names
    servos by their ids, `active` is the joystick table that the buttons obey. The durations of macro commands are
    filled in. Raise ProjectError for values that no board could store.
    """
    return extend_project(Project(project_id), *parts, captions=captions, active=active)


def extend_project(
    project: Project,
    *parts: Part,
    captions: Mapping[int, str] | None = None,
    active: JoystickTable | None = None,
) -> Project:
    """Return `project` with more parts, as `build_project` adds them; a record that it has is not added again."""
    records: list[Any] = [] if active is None else [active]
    parameters = by_servo(project)
    for part in parts:
        if isinstance(part, ServoParameter):
            parameters[part.servo_id] = part
        else:
            records.append(part)
    for servo_id, caption in (captions or {}).items():
        before = parameters.get(servo_id, ServoParameter(servo_id))
        parameters[servo_id] = msgspec.structs.replace(before, servo_caption=caption)
    building = _Building(project)
    for record in records:
        building.expect(record)
    ids = [building.id_of(record) for record in records]
    built = msgspec.structs.replace(
        building.project(),
        servo_parameters=tuple(parameters.values()),
        active_joystick_table=project.active_joystick_table if active is None else ids[0],
    )
    built = _timed(built, {one.macro_id for one in project.macros})
    _refuse_new_errors(project, built)
    return built


def _refuse_new_errors(before: Project, built: Project) -> None:
    """Raise ProjectError for an error that `before` did not have."""
    had = {str(found) for found in validate_project(before)}
    errors = [str(found) for found in validate_project(built) if found.severity == "error" and str(found) not in had]
    if errors:
        raise ProjectError(errors[0] + (f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""))


class _Building:
    """Gives each record an id, once, and to those that call it as well."""

    def __init__(self, project: Project) -> None:
        self._before = project
        self._records = by_kind(project)
        self._taken = {plural: set(records) for plural, records in self._records.items()}
        self._known = {
            plural: {
                with_id(same, 0): record_id
                for record_id, record in records.items()
                for same in (record, _untimed(record))
            }
            for plural, records in self._records.items()
        }
        self._ids: dict[int, int] = {}  # by the object's own identity; 0 until it is in the project

    def project(self) -> Project:
        return with_records(self._before, self._records)

    def expect(self, record: Any, above: int = 0) -> None:
        """Reserve the ids that `record` and what it calls have, so that nothing else gets them."""
        if id(record) in self._ids:
            return
        kind = type_of(record)
        if above > _DEEPEST:
            raise ProjectError(f"{named(record)}: macros nest deeper than {_DEEPEST}")
        self._ids[id(record)] = 0
        self._taken[kind.field].add(kind.id_of(record))
        for _, called in type_of(record).references(record):
            if isinstance(called, RecordRef):
                self.expect(called.record, above + 1)

    def id_of(self, record: Any) -> int:
        """Put `record` into the project, after what it calls; return its id."""
        if done := self._ids[id(record)]:
            return done
        kind = type_of(record)
        plain = type_of(record).with_references(record, self._number)
        anonymous = with_id(plain, 0)
        known, taken = self._known[kind.field], self._taken[kind.field]
        record_id = kind.id_of(plain) or known.get(anonymous) or free_id(taken)
        taken.add(record_id)
        known.setdefault(anonymous, record_id)
        self._store(kind, with_id(plain, record_id))
        self._ids[id(record)] = record_id
        return record_id

    def _store(self, kind: RecordType[Any], record: Any) -> None:
        first = self._records[kind.field].setdefault(kind.id_of(record), record)
        if record not in (first, _untimed(first)):
            raise ProjectError(f"{named(first)} has the id of {named(record)}; give one of them no id")

    def _number(self, kind: RecordType[Any], called: int) -> int:
        return self.id_of(called.record) if isinstance(called, RecordRef) else called


def _untimed(record: Any) -> Any:
    """Return `record` as `Macro.of` makes it, which knows no times."""
    if not isinstance(record, Macro):
        return record
    commands = tuple(msgspec.structs.replace(command, total_interval=0) for command in record.commands)
    return msgspec.structs.replace(record, commands=commands)


def _timed(project: Project, old: Container[int]) -> Project:
    """Return `project` with the times of its macros, but for those that are `old`, and times that were given."""
    found = durations(project)

    def timed(macro: Macro) -> Macro:
        commands = tuple(
            msgspec.structs.replace(command, total_interval=command.total_interval or time or 0)
            for command, time in zip(macro.commands, found[macro.macro_id], strict=True)
        )
        return msgspec.structs.replace(macro, commands=commands)

    macros = tuple(macro if macro.macro_id in old else timed(macro) for macro in project.macros)
    return msgspec.structs.replace(project, macros=macros)
