"""What an import would do, and cost; nothing is changed to find out."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterable
from typing import Any

from msgspec import Struct

from servolink.errors import EncodeError, ProjectError
from servolink.project.model import Project, is_unfinished, without_neutral
from servolink.project.transfer.read import BoardConnection, Content, read_content
from servolink.project.transfer.results import Change, Plan, ProgressCallback
from servolink.project.validate import validate_project
from servolink.protocol.codec import Codec, response_class
from servolink.protocol.editing import (
    AddServoParameterRequest,
    QueryProjectIDRequest,
    QueryServoParameterRequest,
    WriteProjectIDRequest,
)
from servolink.protocol.frame import OVERHEAD
from servolink.protocol.joystick import QueryActiveJoystickTableRequest, SetActiveJoystickTableRequest
from servolink.protocol.layout import content_size
from servolink.protocol.packet import Packet, Request, Result
from servolink.protocol.record_types import RECORD_TYPES, TABLE, RecordType
from servolink.protocol.records import ServoParameter
from servolink.protocol.settings import ClearAllDataRequest, QueryMemorySizeRequest


def compare(old: Project, new: Project) -> tuple[Change, ...]:
    """Return what turns `old` into `new`, in the order of a project file."""
    old, new = old.sorted(), new.sorted()
    changes = _values("project id", old.project_id or None, new.project_id or None)
    changes += _records("servo parameter", _by_servo(old), _by_servo(new))
    for kind in RECORD_TYPES:
        changes += _records(kind.label, kind.by_id(old), kind.by_id(new))
    if new.active_joystick_table in TABLE.by_id(new):
        changes += _values("active joystick table", old.active_joystick_table, new.active_joystick_table)
    return tuple(changes)


def _values(what: str, old: Any, new: Any) -> list[Change]:
    return [] if old == new else [Change(what, old, new)]


def _records(word: str, old: dict[int, Any], new: dict[int, Any]) -> list[Change]:
    return [
        Change(f"{word} {record_id}", old.get(record_id), new.get(record_id))
        for record_id in sorted(old.keys() | new.keys())
        if old.get(record_id) != new.get(record_id)
    ]


def _by_servo(project: Project) -> dict[int, Any]:
    return {one.servo_id: one for one in project.servo_parameters}


class Cost(Struct, frozen=True):
    """Requests with their answers, on a line without damage."""

    requests: int = 0
    wire_bytes: int = 0
    """In both directions."""

    def __add__(self, other: Cost) -> Cost:
        """Return both together."""
        return Cost(self.requests + other.requests, self.wire_bytes + other.wire_bytes)


def cost_of_writing(todo: Iterable[Write], codec: Codec) -> Cost:
    """Return what these requests cost."""
    sizes = [
        len(codec.encode(write.request, unchecked=True)) + _frame_size(response_class(write.request)) for write in todo
    ]
    return Cost(len(sizes), sum(sizes))


def cost_of_marking(times: int) -> Cost:
    """Return what it costs to write the project id so often, and to read it back each time."""
    return Cost(3 * times, times * (_exchange_size(WriteProjectIDRequest(0)) + 2 * _exchange_size(_PROJECT_ID)))


def cost_of_reading(project: Project) -> Cost:
    """Return what it costs to read all of it until two readings agree, which on a good line is twice."""
    outline = [
        _exchange_size(_PROJECT_ID),
        _exchange_size(QueryServoParameterRequest(), len(project.servo_parameters)),
        _exchange_size(QueryActiveJoystickTableRequest()),
        *(_exchange_size(kind.list_request, len(kind.by_id(project))) for kind in RECORD_TYPES),
    ]
    records = [
        _exchange_size(kind.query(record_id), len(kind.parts_of(record)))
        for kind in RECORD_TYPES
        for record_id, record in kind.by_id(project).items()
    ]
    # The outline is read twice before the records and once after them.
    return Cost(3 * len(outline) + 2 * len(records), 3 * sum(outline) + 2 * sum(records))


_PROJECT_ID = QueryProjectIDRequest()


def _exchange_size(request: Request[Any], count: int = 0) -> int:
    """Return the bytes of a request and its response, which has `count` items in its group."""
    return _frame_size(type(request)) + _frame_size(response_class(request), count)


def _frame_size(declared: type[Packet], count: int = 0) -> int:
    return OVERHEAD + content_size(declared, count)


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
    deleting = [write for kind in reversed(RECORD_TYPES) for write in _deletions(kind, content, target)]
    adding = [write for kind in RECORD_TYPES for write in _additions(kind, content, target)]
    return deleting + _parameters(content, target) + adding + _activation(content, target)


def _sound(kind: RecordType[Any], content: Content, target: Project) -> set[int]:
    """Return the ids of the records that are there as they should be: once, and right."""
    entries, wanted = content.records[kind], kind.by_id(target)
    times = Counter(entry.record_id for entry in entries)
    return {
        entry.record_id
        for entry in entries
        if entry.record is not None and times[entry.record_id] == 1 and entry.record == wanted.get(entry.record_id)
    }


def _deletions(kind: RecordType[Any], content: Content, target: Project) -> list[Write]:
    sound = _sound(kind, content, target)
    return [
        Write(f"{kind.label} {entry.record_id}", kind.delete(entry.record_id))
        for entry in content.records[kind]
        if entry.record_id not in sound
    ]


def _additions(kind: RecordType[Any], content: Content, target: Project) -> list[Write]:
    sound = _sound(kind, content, target)
    return [
        Write(f"{kind.label} {record_id}", kind.add(record))
        for record_id, record in kind.by_id(target).items()
        if record_id not in sound
    ]


def _parameters(content: Content, target: Project) -> list[Write]:
    """Write all parameters if one differs: a board may take them for the whole list, or each for itself."""
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
    if content.active == table_id and table_id in _sound(TABLE, content, target):
        return []
    return [Write(f"active joystick table {table_id}", SetActiveJoystickTableRequest(table_id))]


async def plan_project(
    board: BoardConnection,
    project: Project,
    *,
    on_progress: ProgressCallback,
    replace: bool = False,
    unchecked: bool = False,
) -> Plan:
    """Return what `apply_project` would do; ProjectError for a project that cannot be written to any board."""
    check_writable(board, project, unchecked=unchecked)
    loop = asyncio.get_running_loop()
    begun = loop.time()
    content = await read_content(board, on_progress)
    taken = loop.time() - begun
    memory = await board.request(QueryMemorySizeRequest())
    here = content.readable()
    reading = cost_of_reading(here)
    changes = compare(here, project)
    inconsistencies = (
        *(f"{name} is listed more than once" for name in content.doubled()),
        *(f"{name} is listed and not given" for name in content.missing()),
    )
    cost = _cost(board, content, project, replace=replace) if changes or inconsistencies else Cost()
    return Plan(
        changes,
        inconsistencies,
        cost.requests,
        cost.wire_bytes,
        round(cost.requests * taken / reading.requests, 3),
        memory.total_size,
        memory.size,
        memory.size - content.growth(project),
        is_unfinished(content.project_id),
    )


def _cost(board: BoardConnection, content: Content, project: Project, *, replace: bool) -> Cost:
    codec = board.codec
    around = cost_of_reading(content.readable()) + cost_of_marking(2) + cost_of_reading(project.sorted())
    if not replace:
        return around + cost_of_writing(writes(content, project), codec)
    clearing = Write("everything", ClearAllDataRequest())
    cleared = cost_of_reading(Project()) + cost_of_marking(1)
    return around + cost_of_writing([clearing, *writes(Content(), project)], codec) + cleared


def check_writable(board: BoardConnection, project: Project, *, unchecked: bool) -> None:
    """Raise ProjectError for what cannot be written to any board; `unchecked` as in `apply_project`."""
    if not unchecked:
        for problem in validate_project(project, caption_encoding=board.codec.caption_encoding):
            if problem.severity == "error":
                raise ProjectError(f"{problem.path}: {problem.text}")
        return  # what has no error can be written
    for write in writes(Content(), project):
        try:
            board.codec.encode(write.request, unchecked=True)
        except EncodeError as error:
            raise ProjectError(f"{write.item} cannot be written to a board: {error}") from error
