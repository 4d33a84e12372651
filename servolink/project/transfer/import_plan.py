"""Changes and cost of an import, determined without any change to the board."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any

from msgspec import Struct

from servolink.errors import RequestTimeout
from servolink.project.model import UNFINISHED, Project
from servolink.project.transfer.marker import is_same_id
from servolink.project.transfer.pinned import PinnedConnection, ProjectIDBits
from servolink.project.transfer.read import BoardReader, Content
from servolink.project.transfer.results import Change, Memory, Plan, ProgressCallback
from servolink.project.transfer.writing import Write, check_writable, sound_ids, stages
from servolink.protocol import (
    OVERHEAD,
    PACKETS,
    RECORD_TYPES,
    TABLE,
    ClearAllDataRequest,
    Codec,
    Packet,
    QueryActiveJoystickTableRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryServoParameterRequest,
    RecordType,
    Request,
    WriteProjectIDRequest,
    layout,
)
from servolink.support import computed


async def plan_project(
    board: PinnedConnection,
    project: Project,
    *,
    on_progress: ProgressCallback,
    replace: bool = False,
    unchecked: bool = False,
) -> Plan:
    """Return the plan of `apply_project`. Raise ProjectError for a project impossible to write to any board."""
    await check_writable(board, project, unchecked=unchecked)
    project = board.holdable(project)
    loop = asyncio.get_running_loop()
    begun = loop.time()
    content = await BoardReader(board, on_progress, project).read()
    reading_seconds = loop.time() - begun
    memory = await memory_after(board, content, project)
    return await _plan(board, content, project, memory, reading_seconds, replace=replace)


@computed
def _plan(
    board: PinnedConnection,
    content: Content,
    project: Project,
    memory: Memory | None,
    reading_seconds: float,
    *,
    replace: bool,
) -> Plan:
    changes = compare(content.readable(), project, board.project_id_bits)
    inconsistencies = (
        *(f"{name} is listed more than once" for name in content.doubled()),
        *(f"{name} is listed and not returned" for name in content.missing()),
    )
    cost = _cost(board.codec, content, project, replace=replace) if changes or inconsistencies else Cost()
    return Plan(
        changes,
        inconsistencies,
        cost.requests,
        cost.wire_bytes,
        round(estimated_seconds(cost, cost_of_reading(content, project), reading_seconds, board.connection.pace), 3),
        memory,
        content.project_id in UNFINISHED,
    )


async def memory_after(board: PinnedConnection, content: Content, project: Project) -> Memory | None:
    """Return the board's memory with `project` in place of `content`; None if the board does not report it."""
    try:
        found = await board.request(QueryMemorySizeRequest())
    except RequestTimeout:
        return None
    if found.size < 0:
        return None
    unit = board.memory_unit or 1
    size = None if found.total_size is None or found.total_size < 0 else found.total_size * unit
    free = found.size * unit
    return Memory(board.memory_unit, size, free, free - await computed(content.growth)(project))


def compare(old: Project, new: Project, project_id_bits: ProjectIDBits | None = None) -> tuple[Change, ...]:
    """Return the changes from `old` to `new`, in the order of a project file."""
    old, new = old.sorted(), new.sorted()
    changes: list[Change] = []
    if not is_same_id(old.project_id, new.project_id, project_id_bits):
        changes += _values("project id", old.project_id or None, new.project_id or None)
    changes += _records("servo parameter", _by_servo(old), _by_servo(new))
    for record_type in RECORD_TYPES:
        changes += _records(record_type.label, record_type.by_id(old), record_type.by_id(new))
    if new.active_joystick_table in TABLE.by_id(new):
        changes += _values("active joystick table", old.active_joystick_table, new.active_joystick_table)
    return tuple(changes)


def _values(what: str, old: Any, new: Any) -> list[Change]:
    return [] if old == new else [Change(what, old, new)]


def _records(label: str, old: dict[int, Any], new: dict[int, Any]) -> list[Change]:
    return [
        Change(f"{label} {record_id}", old.get(record_id), new.get(record_id))
        for record_id in sorted(old.keys() | new.keys())
        if old.get(record_id) != new.get(record_id)
    ]


def _by_servo(project: Project) -> dict[int, Any]:
    return {one.servo_id: one for one in project.servo_parameters}


# --- the cost on a line without damage, to a board that obeys every request ------------------------------------------


class Cost(Struct, frozen=True):
    """Number of requests with responses, and bytes."""

    requests: int = 0
    wire_bytes: int = 0
    """Bytes in both directions."""

    def __add__(self, other: Cost) -> Cost:
        """Return the sum of both costs."""
        return Cost(self.requests + other.requests, self.wire_bytes + other.wire_bytes)


def estimated_seconds(cost: Cost, reading: Cost, reading_seconds: float, pace: float) -> float:
    """Return the seconds for `cost` on a line where `reading` took `reading_seconds` seconds.

    Bytes take time on a line of `pace` bytes per second; 0 stands for unknown, as with USB, where bytes take hardly any
    time. The rest is round trips, each as long as in the reading.
    """
    on_line = cost.wire_bytes / pace if pace else 0.0
    reading_on_line = reading.wire_bytes / pace if pace else 0.0
    return on_line + cost.requests * max(reading_seconds - reading_on_line, 0.0) / reading.requests


def _cost(codec: Codec, content: Content, project: Project, *, replace: bool) -> Cost:
    empty = Content(servo_parameters=content.servo_parameters)
    before = cost_of_reading(content, project) + _sum([_exchange(QueryMemorySizeRequest())])
    # The project id is read twice at the beginning and once before the marker is written, at the start of the change.
    marking = _sum([_exchange(_PROJECT_ID)] * 3) + cost_of_project_id(2)
    if not replace:
        return before + marking + cost_of_writing(stages(content, project), codec) + cost_of_checking(content, project)
    clearing = Write("everything", ClearAllDataRequest())
    cleared = cost_of_writing([[clearing]], codec) + cost_of_project_id(1) + cost_of_reading(Content(), project)
    writing = cost_of_writing(stages(Content(), project), codec) + cost_of_checking(empty, project)
    return before + marking + cleared + writing


def cost_of_writing(todo: Iterable[Iterable[Write]], codec: Codec) -> Cost:
    """Return the cost of the requests, with a reading after each added record."""
    sizes = []
    for write in (write for stage in todo for write in stage):
        sizes.append(len(codec.encode(write.request, unchecked=True)) + _frame_size(PACKETS.response_of(write.request)))
        if write.record_type is not None and write.record is not None:
            sizes.append(_record_exchange(write.record_type, write.record))
    return _sum(sizes)


def cost_of_project_id(times: int) -> Cost:
    """Return the cost of writing the project id `times` times, each write with a reading."""
    return _sum([_exchange(WriteProjectIDRequest(0)), _exchange(_PROJECT_ID)] * times)


def cost_of_reading(content: Content, target: Project) -> Cost:
    """Return the cost of reading a board with `content`, expected to hold `target`."""
    sizes = [*_outline(content, target), _exchange(_PROJECT_ID)]
    for record_type in RECORD_TYPES:
        entries = content.records[record_type]
        sound = sound_ids(record_type, content, target)
        times = 1 if len({entry.record_id for entry in entries if entry.record is not None}) == len(entries) else 2
        sizes += [_exchange(record_type.list_request, len(entries))] * times
        for entry in entries:
            sizes += [_record_exchange(record_type, entry.record)] * (1 if entry.record_id in sound else 2)
    return _sum(sizes)


def cost_of_checking(content: Content, target: Project) -> Cost:
    """Return the cost of the check that `target` has replaced `content`."""
    after = Content(0, target.sorted().servo_parameters, target.active_joystick_table)
    lists = [_exchange(each.list_request, len(each.by_id(target))) for each in RECORD_TYPES]
    return _sum([_exchange(_PROJECT_ID), *_outline(after, target), *lists])


def _outline(content: Content, target: Project) -> list[int]:
    parameters = _exchange(QueryServoParameterRequest(), len(content.servo_parameters))
    active = _exchange(QueryActiveJoystickTableRequest())
    return [
        _exchange(_PROJECT_ID),
        *[parameters] * (1 if content.servo_parameters == target.sorted().servo_parameters else 2),
        *[active] * (1 if content.active == target.active_joystick_table else 2),
    ]


_PROJECT_ID = QueryProjectIDRequest()


def _sum(sizes: list[int]) -> Cost:
    return Cost(len(sizes), sum(sizes))


def _record_exchange(record_type: RecordType[Any], record: Any | None) -> int:
    return _exchange(record_type.query(0), 0 if record is None else len(record_type.parts_of(record)))


def _exchange(request: Request[Any], count: int = 0) -> int:
    """Return the bytes of a request and of the response with `count` items in the group."""
    return _frame_size(type(request)) + _frame_size(PACKETS.response_of(request), count)


def _frame_size(declared: type[Packet], count: int = 0) -> int:
    return OVERHEAD + layout(declared, "little").size(count)
