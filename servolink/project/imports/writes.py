"""What has to be written to a board so that it holds a project; nothing if it does."""

from __future__ import annotations

from collections import Counter

from msgspec import Struct

from servolink.project.imports.read import Content
from servolink.project.kinds import KINDS, TABLE, Kind
from servolink.project.model import Project, telling
from servolink.protocol.editing import AddServoParameterRequest, ServoParameter
from servolink.protocol.joystick import SetActiveJoystickTableRequest
from servolink.protocol.packet import Request, Result


class Write(Struct, frozen=True):
    """One request, and what people call its object."""

    item: str
    request: Request[Result]


def writes(content: Content, target: Project) -> list[Write]:
    """Return the requests that turn `content` into `target`, but for the project id, in the order to send them.

    A record that differs is deleted and added again, whatever a board does with an id that is taken. What calls
    something is deleted before it and added after it.
    """
    target = target.sorted()
    deleting = [write for kind in reversed(KINDS) for write in _deletions(kind, content, target)]
    adding = [write for kind in KINDS for write in _additions(kind, content, target)]
    return deleting + _parameters(content, target) + adding + _activation(content, target)


def _sound(kind: Kind, content: Content, target: Project) -> set[int]:
    """Return the ids of the records that are there as they should be: once, and right."""
    entries, wanted = content.records[kind], kind.of(target)
    times = Counter(entry.record_id for entry in entries)
    return {
        entry.record_id
        for entry in entries
        if entry.record is not None and times[entry.record_id] == 1 and entry.record == wanted.get(entry.record_id)
    }


def _deletions(kind: Kind, content: Content, target: Project) -> list[Write]:
    sound = _sound(kind, content, target)
    return [
        Write(f"{kind.word} {entry.record_id}", kind.delete(entry.record_id))
        for entry in content.records[kind]
        if entry.record_id not in sound
    ]


def _additions(kind: Kind, content: Content, target: Project) -> list[Write]:
    sound = _sound(kind, content, target)
    return [
        Write(f"{kind.word} {record_id}", kind.add(record))
        for record_id, record in kind.of(target).items()
        if record_id not in sound
    ]


def _parameters(content: Content, target: Project) -> list[Write]:
    """Write all parameters if one differs: a board may take them for the whole list, or each for itself."""
    there = telling(content.servo_parameters)
    if sorted(there, key=lambda one: one.servo_id) == list(target.servo_parameters):
        return []
    kept = {one.servo_id for one in target.servo_parameters}
    neutral = tuple(ServoParameter(servo_id) for servo_id in sorted({one.servo_id for one in there} - kept))
    return [Write("servo parameters", AddServoParameterRequest(target.servo_parameters + neutral))]


def _activation(content: Content, target: Project) -> list[Write]:
    table_id = target.active_joystick_table
    if table_id is None or table_id not in TABLE.of(target):
        return []
    if content.active == table_id and table_id in _sound(TABLE, content, target):
        return []
    return [Write(f"active joystick table {table_id}", SetActiveJoystickTableRequest(table_id))]
