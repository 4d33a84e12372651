"""Merging of two projects into a single project."""

from __future__ import annotations

from typing import Any

from msgspec.structs import replace

from servolink.errors import ProjectError, escape
from servolink.project.model import Project, name_of, without_neutral
from servolink.project.record_lookup import free_id, with_id, with_records
from servolink.protocol import RECORD_TYPES, TABLE, RecordType, ServoParameter


def merge_projects(one: Project, other: Project) -> tuple[Project, list[str]]:
    """Return `one` with the missing records of `other` added, and the list of changes.

    Identical records are kept once. A record of `other` with an id used differently in `one` gets a new id, in all
    references too. For values possible only once, `one` decides: project id, parameters of a servo, active table. Raise
    ProjectError for a duplicate id within a project, and for references to missing records, which could come to mean a
    record of the other project.
    """
    for project in (one, other):
        _refuse_dangling_references(project)
    merging = _Merging(one, other)
    for kind in RECORD_TYPES:
        merging.assign_ids(kind)
    merging.add()
    changes = merging.changes
    parameters = _parameters(one, other, changes)
    project_id = one.project_id or other.project_id
    if other.project_id not in (0, project_id):
        changes.append(f"project id {project_id} stays; {other.project_id} is dropped")
    active = one.active_joystick_table
    if active is None and other.active_joystick_table is not None:
        active = merging.id_of(TABLE, other.active_joystick_table)
    elif other.active_joystick_table is not None and active != merging.id_of(TABLE, other.active_joystick_table):
        changes.append(f"joystick table {active} stays active")
    project = replace(
        with_records(one, merging.records),
        project_id=project_id,
        servo_parameters=parameters,
        active_joystick_table=active,
    )
    return project, changes


def _refuse_dangling_references(project: Project) -> None:
    shelves = project.by_type()
    for shelf in shelves.values():
        for record in shelf.values():
            for kind, number in RecordType.of(record).references(record):
                if number and number not in shelves[kind.field]:
                    raise ProjectError(
                        f"{name_of(record)} refers to {kind} {number}, which is missing; correct the reference first"
                    )


class _Merging:
    """Assigns ids to the records of the other project, and adds the new records."""

    def __init__(self, one: Project, other: Project) -> None:
        self.changes: list[str] = []
        self.records = one.by_type()
        # Record without an id, to id; of several identical records the lowest id, as in an earlier merge.
        self._ids_of_records = {
            field: {with_id(records[record_id], 0): record_id for record_id in sorted(records, reverse=True)}
            for field, records in self.records.items()
        }
        self._others = other.by_type()
        self._used_ids = {field: {*self.records[field], *others} for field, others in self._others.items()}
        self._new_ids: dict[tuple[str, int], int] = {}

    def id_of(self, kind: RecordType[Any], record_id: int) -> int:
        """Return the new id of a record from the other project."""
        return self._new_ids.get((kind.field, record_id), record_id)

    def assign_ids(self, kind: RecordType[Any]) -> None:
        """Assign ids to the other project's records of a type, after all types referred to by this type.

        Repeated until nothing changes: a macro with a reference to a new id differs now, and may need a new id too.
        """
        changed = True
        while changed:
            changed = False
            for record_id in self._others[kind.field]:
                changed |= self._assign_id(kind, record_id)

    def _assign_id(self, kind: RecordType[Any], record_id: int) -> bool:
        """Assign another id to a record if needed. Return whether the id changed."""
        now = self.id_of(kind, record_id)
        record = self._renumbered(kind, self._others[kind.field][record_id], now)
        if self.records[kind.field].get(now, record) == record:
            return False
        key = (kind.field, record_id)
        alike = self._ids_of_records[kind.field].get(with_id(record, 0))
        if alike is not None and key not in self._new_ids:
            self._new_ids[key] = alike
        else:
            self._new_ids[key] = free_id(self._used_ids[kind.field])
            self._used_ids[kind.field].add(self._new_ids[key])
        return True

    def add(self) -> None:
        """Add the records of the other project not yet in `records`."""
        for kind in RECORD_TYPES:
            shelf = self.records[kind.field]
            for record_id, record in self._others[kind.field].items():
                new_id = self.id_of(kind, record_id)
                if new_id not in shelf:
                    shelf[new_id] = self._renumbered(kind, record, new_id)
                    self.changes.append(f"{name_of(record)} added" + (f" as {new_id}" if new_id != record_id else ""))
                elif new_id != record_id:
                    self.changes.append(f"{name_of(record)} is {name_of(shelf[new_id])}")

    def _renumbered(self, kind: RecordType[Any], record: Any, record_id: int) -> Any:
        return with_id(kind.with_references(record, self.id_of), record_id)


def _parameters(one: Project, other: Project, changes: list[str]) -> tuple[ServoParameter, ...]:
    parameters = one.by_servo()
    for added in without_neutral(other.by_servo().values()):
        existing = parameters.get(added.servo_id)
        if existing is None or not without_neutral([existing]):
            parameters[added.servo_id] = added
            changes.append(f"servo {added.servo_id} '{escape(added.servo_caption)}' added")
        elif existing != added:
            changes.append(
                f"servo {existing.servo_id} stays '{escape(existing.servo_caption)}' with a correction of "
                f"{existing.adjusted_degree}; '{escape(added.servo_caption)}' with {added.adjusted_degree} is dropped"
            )
    return tuple(parameters.values())
