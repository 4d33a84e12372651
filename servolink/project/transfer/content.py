"""The content of a board as it was read, sound or not: with records that are listed twice, or listed and not given."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from servolink.errors import ProjectError
from servolink.project.model import Project, without_neutral
from servolink.project.records import total_size
from servolink.protocol.record_types import RECORD_TYPES, RecordType, stored_size
from servolink.protocol.records import ServoParameter


@dataclass(frozen=True, slots=True)
class Listed:
    """One entry of a list on the board."""

    record_id: int
    record: Any | None
    """The record that the board returns for this id; None if it returns none, or one that cannot be decoded."""


@dataclass
class Content:
    """Everything on a board; nothing by default."""

    project_id: int = 0
    servo_parameters: tuple[ServoParameter, ...] = ()
    active: int | None = None
    records: dict[RecordType[Any], tuple[Listed, ...]] = field(default_factory=lambda: dict.fromkeys(RECORD_TYPES, ()))
    """In the order of the board's lists, with ids that are listed twice."""

    def project(self) -> Project:
        """Return it as a project. Raise ProjectError if the board lists a record that it does not return."""
        for record_type, entries in self.records.items():
            for entry in entries:
                if entry.record is None:
                    raise ProjectError(
                        f"{record_type} {entry.record_id}: the board lists it and does not return it, or returns "
                        f"something that is not a valid {record_type}; delete it there, or go on without keeping what "
                        "the board has"
                    )
        return self.readable()

    def readable(self) -> Project:
        """Return as a project what the board returns, without records that it only lists."""
        records = {
            record_type.field: tuple({one.record_id: one.record for one in entries if one.record is not None}.values())
            for record_type, entries in self.records.items()
        }
        parameters = tuple({one.servo_id: one for one in self.servo_parameters}.values())
        return Project(self.project_id, parameters, active_joystick_table=self.active, **records).sorted()

    def doubled(self) -> list[str]:
        """Return what is listed more than once, of which a board returns only one."""
        listed = {str(record_type): self.ids_of(record_type) for record_type in self.records}
        listed["servo parameter"] = [one.servo_id for one in self.servo_parameters]
        return [
            f"{label} {record_id}"
            for label, ids in listed.items()
            for record_id, times in sorted(Counter(ids).items())
            if times > 1
        ]

    def missing(self) -> list[str]:
        """Return what is listed and not returned."""
        return [
            f"{record_type} {entry.record_id}"
            for record_type, entries in self.records.items()
            for entry in entries
            if entry.record is None
        ]

    def ids_of(self, record_type: RecordType[Any]) -> list[int]:
        """Return the ids in the board's list of a type."""
        return [entry.record_id for entry in self.records[record_type]]

    def is_empty(self) -> bool:
        """Return whether nothing is stored but, perhaps, the project id."""
        return not any(self.records.values()) and not without_neutral(self.servo_parameters)

    def growth(self, project: Project) -> int:
        """Return how many bytes more `project` takes than the content that it replaces."""
        records = [entry.record for entries in self.records.values() for entry in entries if entry.record is not None]
        kept = {one.servo_id for one in without_neutral(project.servo_parameters)}
        neutral = [one for one in self.servo_parameters if one.servo_id not in kept]
        stored = sum(map(stored_size, (*self.servo_parameters, *records)))
        return total_size(project) + sum(map(stored_size, neutral)) - stored
