"""Other captions."""

from __future__ import annotations

import msgspec

from servolink.errors import ProjectError
from servolink.printable import printable
from servolink.project.kinds import Kind
from servolink.project.model import Project
from servolink.project.records import by_kind, by_servo, named, with_records
from servolink.protocol.editing import ServoParameter


def renamed(project: Project, kind: Kind, record_id: int, caption: str) -> tuple[Project, list[str]]:
    """Return `project` with another caption for a record, and what was changed; ProjectError if there is none."""
    records = by_kind(project)
    shelf = records[kind.plural]
    if (record := shelf.get(record_id)) is None:
        raise ProjectError(f"there is no {kind.word} {record_id}")
    if kind.caption_of(record) == caption:
        return project, []
    shelf[record_id] = msgspec.structs.replace(record, **{record.__struct_fields__[1]: caption})
    return with_records(project, records), [f"{named(record)} is now '{printable(caption)}'"]


def renamed_servo(project: Project, servo_id: int, caption: str) -> tuple[Project, list[str]]:
    """Return `project` with another caption for a servo, which it need not have had, and what was changed."""
    parameters = by_servo(project)
    before = parameters.get(servo_id, ServoParameter(servo_id))
    if before.servo_caption == caption:
        return project, []
    parameters[servo_id] = msgspec.structs.replace(before, servo_caption=caption)
    said = f"servo {servo_id} '{printable(before.servo_caption)}' is now '{printable(caption)}'"
    return msgspec.structs.replace(project, servo_parameters=tuple(parameters.values())), [said]
