"""Two projects in one."""

from __future__ import annotations

from typing import Any

import msgspec

from servolink.errors import ProjectError
from servolink.escaping import escape
from servolink.project.model import Project, telling
from servolink.project.records import by_kind, by_servo, free_id, named, with_id, with_records
from servolink.protocol.record_types import RECORD_TYPES, TABLE, RecordType, type_of


def merge_projects(one: Project, other: Project) -> tuple[Project, list[str]]:
    """Return `one` with all that `other` has besides, and what was done; ProjectError for ids that are used twice.

    What is the same in both is there once. A record of `other` whose id means something else in `one` gets a new id,
    and whoever calls it calls the new one. Where there can be only one (project id, servo parameters, active table),
    that of `one` stays. ProjectError also for calls of what is not there, which the other project could seem to mean.
    """
    for project in (one, other):
        _refuse_lost_calls(project)
    merging = _Merging(one, other)
    for kind in RECORD_TYPES:
        merging.settle(kind)
    merging.add()
    said = merging.said
    parameters = _parameters(one, other, said)
    project_id = one.project_id or other.project_id
    if other.project_id not in (0, project_id):
        said.append(f"project id {project_id} stays, {other.project_id} goes")
    active = one.active_joystick_table
    if active is None and other.active_joystick_table is not None:
        active = merging.id_of(TABLE, other.active_joystick_table)
    elif other.active_joystick_table is not None and active != merging.id_of(TABLE, other.active_joystick_table):
        said.append(f"joystick table {active} stays the active one")
    project = msgspec.structs.replace(
        with_records(one, merging.records),
        project_id=project_id,
        servo_parameters=parameters,
        active_joystick_table=active,
    )
    return project, said


def _refuse_lost_calls(project: Project) -> None:
    shelves = by_kind(project)
    for shelf in shelves.values():
        for record in shelf.values():
            for kind, called in type_of(record).references(record):
                if called and called not in shelves[kind.field]:
                    raise ProjectError(
                        f"{named(record)} calls {kind.label} {called}, which is not there: correct it first"
                    )


class _Merging:
    def __init__(self, one: Project, other: Project) -> None:
        self.said: list[str] = []
        self.records = by_kind(one)
        self._known = {
            # Of several that are alike the one with the lowest id: so it was, too, when they were merged before.
            plural: {with_id(records[record_id], 0): record_id for record_id in sorted(records, reverse=True)}
            for plural, records in self.records.items()
        }
        self._others = by_kind(other)
        self._taken = {plural: {*self.records[plural], *others} for plural, others in self._others.items()}
        self._ids: dict[tuple[str, int], int] = {}  # of those that are to have another one

    def id_of(self, kind: RecordType[Any], record_id: int) -> int:
        """Return the id that a record of the other project is to have."""
        return self._ids.get((kind.field, record_id), record_id)

    def settle(self, kind: RecordType[Any]) -> None:
        """Find the ids of all records of one kind, when those of what they call are known."""
        unsettled = True
        while unsettled:  # a macro that calls one that gets another id has changed itself, and so on
            unsettled = False
            for record_id in self._others[kind.field]:
                unsettled |= self._settle_one(kind, record_id)

    def add(self) -> None:
        """Put into `records` what is not there yet."""
        for kind in RECORD_TYPES:
            shelf = self.records[kind.field]
            for record_id, record in self._others[kind.field].items():
                new_id = self.id_of(kind, record_id)
                if new_id not in shelf:
                    shelf[new_id] = self._under(kind, record, new_id)
                    self.said.append(f"{named(record)} added" + (f" as {new_id}" if new_id != record_id else ""))
                elif new_id != record_id:
                    self.said.append(f"{named(record)} is {named(shelf[new_id])}")

    def _settle_one(self, kind: RecordType[Any], record_id: int) -> bool:
        """Return whether a record needed another id."""
        shelf = self.records[kind.field]
        now = self.id_of(kind, record_id)
        record = self._under(kind, self._others[kind.field][record_id], now)
        if shelf.get(now, record) == record:
            return False
        moved = (kind.field, record_id) in self._ids
        alike = self._known[kind.field].get(with_id(record, 0))
        if alike is not None and not moved:
            self._ids[kind.field, record_id] = alike
        else:
            new_id = free_id(self._taken[kind.field])
            self._taken[kind.field].add(new_id)
            self._ids[kind.field, record_id] = new_id
        return True

    def _under(self, kind: RecordType[Any], record: Any, record_id: int) -> Any:
        return with_id(type_of(record).with_references(record, self.id_of), record_id)


def _parameters(one: Project, other: Project, said: list[str]) -> tuple[Any, ...]:
    parameters = by_servo(one)
    for theirs in telling(by_servo(other).values()):
        ours = parameters.get(theirs.servo_id)
        if ours is None or not telling([ours]):
            parameters[theirs.servo_id] = theirs
            said.append(f"servo {theirs.servo_id} '{escape(theirs.servo_caption)}' added")
        elif ours != theirs:
            said.append(
                f"servo {ours.servo_id} stays '{escape(ours.servo_caption)}' with a correction of "
                f"{ours.adjusted_degree}; '{escape(theirs.servo_caption)}' with {theirs.adjusted_degree} goes"
            )
    return tuple(parameters.values())
