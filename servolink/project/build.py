"""Construction of projects from parts with references to each other by object."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any, TypeAlias

from msgspec.structs import replace

from servolink.errors import ProjectError
from servolink.project.model import Project, name_of
from servolink.project.record_lookup import durations, free_id, with_id, with_records
from servolink.project.validate import validate_project
from servolink.protocol import Action, JoystickTable, Macro, RecordRef, RecordType, ServoParameter
from servolink.support import as_number

Part: TypeAlias = Action | Macro | JoystickTable | ServoParameter

_MAX_DEPTH = 100
"""Maximum levels of macros within macros; boards play fewer."""


def build_project(
    *parts: Part,
    project_id: int = 0,
    captions: Mapping[int, str] | None = None,
    active: JoystickTable | None = None,
) -> Project:
    """Return the project of `parts` and of all records referred to by the parts.

    A record without an id gets the lowest free id, in the order of the first mention. `captions` are captions of
    servos by id, `active` is the joystick table for the buttons. The durations of macro commands are filled in. Raise
    ProjectError for values impossible to store on any board.
    """
    return extend_project(Project(project_id), *parts, captions=captions, active=active)


def extend_project(
    project: Project,
    *parts: Part,
    captions: Mapping[int, str] | None = None,
    active: JoystickTable | None = None,
    caption_encoding: str = "utf-8",
) -> Project:
    """Return `project` with more parts, added as by `build_project`; records already present are not added again.

    `caption_encoding` is the caption encoding of the board.
    """
    records: list[Any] = [] if active is None else [active]
    parameters = project.by_servo()
    for part in parts:
        if isinstance(part, ServoParameter):
            parameters[part.servo_id] = part
        else:
            records.append(part)
    for servo_id, caption in (captions or {}).items():
        before = parameters.get(servo_id, ServoParameter(as_number(servo_id)))
        parameters[servo_id] = replace(before, servo_caption=caption)
    building = _Building(project)
    for record in records:
        building.expect(record)
    ids = [building.id_of(record) for record in records]
    built = replace(
        building.project(),
        servo_parameters=tuple(parameters.values()),
        active_joystick_table=project.active_joystick_table if active is None else ids[0],
    )
    built = _with_durations(built, {one.macro_id for one in project.macros})
    refuse_new_errors(project, built, caption_encoding)
    return built


def refuse_new_errors(before: Project, built: Project, caption_encoding: str = "utf-8") -> None:
    """Raise ProjectError for the first error in `built` but not in `before`."""
    had = {str(found) for found in validate_project(before, caption_encoding=caption_encoding)}
    found = validate_project(built, caption_encoding=caption_encoding)
    errors = [str(one) for one in found if one.severity == "error" and str(one) not in had]
    if errors:
        raise ProjectError(errors[0] + (f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""))


class _Building:
    """Assigns an id to each record, and puts the id into all references to the record."""

    def __init__(self, project: Project) -> None:
        self._before = project
        self._records = project.by_type()
        self._used_ids = {field: set(records) for field, records in self._records.items()}
        self._plain_ids = {  # record without an id, with and without durations, to id
            field: {
                with_id(form, 0): record_id
                for record_id, record in records.items()
                for form in (record, _without_durations(record))
            }
            for field, records in self._records.items()
        }
        self._ids: dict[int, int] = {}  # by `id()` of the record; 0 before the record is in the project

    def project(self) -> Project:
        return with_records(self._before, self._records)

    def expect(self, record: Any, depth: int = 0) -> None:
        """Reserve the ids of `record` and of the records referred to, so that no other record gets them."""
        if id(record) in self._ids:
            return
        kind = RecordType.of(record)
        if depth > _MAX_DEPTH:
            raise ProjectError(f"{name_of(record)}: macros nest deeper than {_MAX_DEPTH}")
        self._ids[id(record)] = 0
        self._used_ids[kind.field].add(kind.id_of(record))
        for _, reference in kind.references(record):
            if isinstance(reference, RecordRef):
                self.expect(reference.record, depth + 1)

    def id_of(self, record: Any) -> int:
        """Add `record` to the project, after all records referred to, and return the record id."""
        if done := self._ids[id(record)]:
            return done
        kind = RecordType.of(record)
        plain = kind.with_references(record, self._plain_id)
        anonymous = with_id(plain, 0)
        ids, used_ids = self._plain_ids[kind.field], self._used_ids[kind.field]
        record_id = kind.id_of(plain) or ids.get(anonymous) or free_id(used_ids)
        used_ids.add(record_id)
        ids.setdefault(anonymous, record_id)
        self._store(kind, with_id(plain, record_id))
        self._ids[id(record)] = record_id
        return record_id

    def _plain_id(self, kind: RecordType[Any], reference: int) -> int:
        return self.id_of(reference.record) if isinstance(reference, RecordRef) else reference

    def _store(self, kind: RecordType[Any], record: Any) -> None:
        first = self._records[kind.field].setdefault(kind.id_of(record), record)
        if record not in (first, _without_durations(first)):
            raise ProjectError(f"{name_of(first)} and {name_of(record)} have the same id; leave out one of the ids")


def _without_durations(record: Any) -> Any:
    """Return `record` without the durations of commands, as created by `Macro.of`."""
    if not isinstance(record, Macro):
        return record
    return replace(record, commands=tuple(replace(command, total_interval=0) for command in record.commands))


def _with_durations(project: Project, old: Container[int]) -> Project:
    """Return `project` with missing durations of macros filled in, except macros with ids in `old`."""
    found = durations(project)

    def completed(macro: Macro) -> Macro:
        commands = tuple(
            replace(command, total_interval=command.total_interval or takes or 0)
            for command, takes in zip(macro.commands, found[macro.macro_id], strict=True)
        )
        return replace(macro, commands=commands)

    macros = tuple(macro if macro.macro_id in old else completed(macro) for macro in project.macros)
    return replace(project, macros=macros)
