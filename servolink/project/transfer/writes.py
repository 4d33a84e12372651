"""The requests that make a board hold a project, in an order that gives no board a reason to refuse one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

from msgspec import Struct

from servolink.errors import EncodeError, ProjectError
from servolink.project.model import Project, without_neutral
from servolink.project.records import dependency_levels
from servolink.project.transfer.content import Content
from servolink.project.transfer.pinned import BoardConnection
from servolink.project.validate import validate_project
from servolink.protocol.editing import AddServoParameterRequest
from servolink.protocol.joystick import SetActiveJoystickTableRequest
from servolink.protocol.packet import Request, Result
from servolink.protocol.record_types import MACRO, RECORD_TYPES, TABLE, RecordType
from servolink.protocol.records import ServoParameter


class Write(Struct, frozen=True):
    """One request, and the name of the object that it changes."""

    item: str
    request: Request[Result]
    record_type: RecordType[Any] | None = None
    """None for servo parameters and the active table."""
    record_id: int = 0
    record: Any = None
    """The record to add; None to delete the one with this id."""


def writes(content: Content, target: Project) -> list[Write]:
    """Return the requests of all stages, in their order."""
    return [write for stage in stages(content, target) for write in stage]


def stages(content: Content, target: Project) -> list[list[Write]]:
    """Return the requests that turn `content` into `target`, but for the project id.

    The writes of one stage do not depend on one another; each stage depends on those before it. A record that differs
    is deleted and added again, whatever a board does with an id that is taken. A record is deleted before those that
    it refers to, and added after them.
    """
    target = target.sorted()
    deletions = [_deletions(record_type, content, target) for record_type in RECORD_TYPES]
    additions = [_additions(record_type, content, target) for record_type in RECORD_TYPES]
    found = [stage for of_type in reversed(deletions) for stage in reversed(of_type)]
    found += [_parameters(content, target)]
    found += [stage for of_type in additions for stage in of_type]
    found += [_activation(content, target)]
    return [stage for stage in found if stage]


def sound_ids(record_type: RecordType[Any], content: Content, target: Project) -> set[int]:
    """Return the ids of the records that are on the board as they should be: once, and equal to the target's."""
    wanted, times = record_type.by_id(target), Counter(content.ids_of(record_type))
    return {
        entry.record_id
        for entry in content.records[record_type]
        if entry.record is not None and times[entry.record_id] == 1 and entry.record == wanted.get(entry.record_id)
    }


def _deletions(record_type: RecordType[Any], content: Content, target: Project) -> list[list[Write]]:
    """Return the deletions in levels, of which a later one holds what refers to an earlier one."""
    sound = sound_ids(record_type, content, target)
    entries = [entry for entry in content.records[record_type] if entry.record_id not in sound]
    levels = _levels(record_type, {entry.record_id: entry.record for entry in entries})
    return [
        [
            Write(f"{record_type} {entry.record_id}", record_type.delete(entry.record_id), record_type, entry.record_id)
            for entry in entries
            if entry.record_id in level
        ]
        for level in levels
    ]


def _additions(record_type: RecordType[Any], content: Content, target: Project) -> list[list[Write]]:
    sound = sound_ids(record_type, content, target)
    wanted = {number: record for number, record in record_type.by_id(target).items() if number not in sound}
    return [
        [
            Write(f"{record_type} {number}", record_type.add(record), record_type, number, record)
            for number, record in wanted.items()
            if number in level
        ]
        for level in _levels(record_type, wanted)
    ]


def _levels(record_type: RecordType[Any], records: dict[int, Any]) -> list[set[int]]:
    """Return ids in levels: macros refer to other macros, actions and tables to none of their own type."""
    if record_type is not MACRO:
        return [set(records)]
    levels = dependency_levels({number: record for number, record in records.items() if record is not None})
    # Macros in a cycle, and those that the board does not return, have no place in the order.
    return [*levels, set(records).difference(*levels)]


def _parameters(content: Content, target: Project) -> list[Write]:
    """Write all parameters if one differs: a board may take them as the whole list, or each for itself."""
    there = without_neutral(content.servo_parameters)
    if sorted(there, key=lambda one: one.servo_id) == list(target.servo_parameters):
        return []
    kept = {one.servo_id for one in target.servo_parameters}
    neutral = tuple(ServoParameter(servo_id) for servo_id in sorted({one.servo_id for one in there} - kept))
    return [Write("servo parameters", AddServoParameterRequest(target.servo_parameters + neutral))]


def _activation(content: Content, target: Project) -> list[Write]:
    table_id = target.active_joystick_table
    if table_id is None or table_id not in TABLE.by_id(target):
        return []
    if content.active == table_id and table_id in sound_ids(TABLE, content, target):
        return []
    return [Write(f"active joystick table {table_id}", SetActiveJoystickTableRequest(table_id))]


def check_writable(board: BoardConnection, project: Project, *, unchecked: bool) -> None:
    """Raise ProjectError for a project that no board can store; `unchecked` as in `apply_project`."""
    if not unchecked:
        for problem in validate_project(project, caption_encoding=board.codec.caption_encoding):
            if problem.severity == "error":
                raise ProjectError(f"{problem.path}: {problem.text}")
        return  # a project without errors can be written
    for write in writes(Content(), project):
        try:
            board.codec.encode(write.request, unchecked=True)
        except EncodeError as error:
            raise ProjectError(f"{write.item} cannot be written to a board: {error}") from error


def items_of(todo: Iterable[Write]) -> set[str]:
    """Return the names of what is written."""
    return {write.item for write in todo}
