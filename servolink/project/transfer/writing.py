"""Writing of a project to a board: requests in an order that gives the board no reason to refuse, and the sending."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable, Collection, Iterable, Sequence
from typing import Any

from msgspec import Struct

from servolink.errors import EncodeError, OutcomeUnknown, ProjectError, RequestTimeout
from servolink.project.model import Project, without_neutral
from servolink.project.record_lookup import dependency_levels
from servolink.project.transfer.pinned import BoardConnection, in_parallel
from servolink.project.transfer.read import BoardReader, Content
from servolink.project.transfer.results import Progress, ProgressCallback
from servolink.project.validate import validate_project
from servolink.protocol import (
    MACRO,
    RECORD_TYPES,
    TABLE,
    AddServoParameterRequest,
    RecordType,
    Request,
    Result,
    ServoParameter,
    SetActiveJoystickTableRequest,
)
from servolink.support import computed


class Write(Struct, frozen=True):
    """Single request, with the name of the changed object."""

    item: str
    request: Request[Result]
    record_type: RecordType[Any] | None = None
    """None for servo parameters and the active table."""
    record_id: int = 0
    record: Any = None
    """Record to add; None to delete the record with this id."""


def writes(content: Content, target: Project) -> list[Write]:
    """Return the requests of all stages in order."""
    return [write for stage in stages(content, target) for write in stage]


def stages(content: Content, target: Project) -> list[list[Write]]:
    """Return the requests to turn `content` into `target`, except for the project id.

    The writes of a stage are independent of each other; each stage depends on the stages before. A changed record is
    deleted and added again, because boards treat an id in use in different ways. Records are deleted before the records
    referred to, and added after them.
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
    """Return the ids of the records as wanted on the board: stored once, and equal to the target's."""
    targets, times = record_type.by_id(target), Counter(content.ids_of(record_type))
    return {
        entry.record_id
        for entry in content.records[record_type]
        if entry.record is not None and times[entry.record_id] == 1 and entry.record == targets.get(entry.record_id)
    }


def _deletions(record_type: RecordType[Any], content: Content, target: Project) -> list[list[Write]]:
    """Return the deletions in levels: records of a later level may refer to records of an earlier level."""
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
    targets = {number: record for number, record in record_type.by_id(target).items() if number not in sound}
    return [
        [
            Write(f"{record_type} {number}", record_type.add(record), record_type, number, record)
            for number, record in targets.items()
            if number in level
        ]
        for level in _levels(record_type, targets)
    ]


def _levels(record_type: RecordType[Any], records: dict[int, Any]) -> list[set[int]]:
    """Return ids in levels: macros refer to other macros, actions and tables to none of their own type."""
    if record_type is not MACRO:
        return [set(records)]
    levels = dependency_levels({number: record for number, record in records.items() if record is not None})
    # Macros in a cycle, and macros not returned by the board, have no place in the order.
    return [*levels, set(records).difference(*levels)]


def _parameters(content: Content, target: Project) -> list[Write]:
    """Write all parameters after any difference: a board may take the list as a whole, or each entry separately."""
    present = without_neutral(content.servo_parameters)
    if sorted(present, key=lambda one: one.servo_id) == list(target.servo_parameters):
        return []
    target_ids = {one.servo_id for one in target.servo_parameters}
    neutral = tuple(ServoParameter(servo_id) for servo_id in sorted({one.servo_id for one in present} - target_ids))
    return [Write("servo parameters", AddServoParameterRequest(target.servo_parameters + neutral))]


def _activation(content: Content, target: Project) -> list[Write]:
    table_id = target.active_joystick_table
    if table_id is None or table_id not in TABLE.by_id(target):
        return []
    if content.active == table_id and table_id in sound_ids(TABLE, content, target):
        return []
    return [Write(f"active joystick table {table_id}", SetActiveJoystickTableRequest(table_id))]


@computed
def check_writable(board: BoardConnection, project: Project, *, unchecked: bool) -> None:
    """Raise ProjectError for a project impossible to store on any board; `unchecked` as in `apply_project`."""
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
    """Return the names of all items to write."""
    return {write.item for write in todo}


_TRIES = 4
"""Maximum writes of a record in a pass, as long as each reading shows the write as lost."""
_CHECK_EVERY = 64
"""Number of writes between checks of the marker: another program may have begun an import."""
_MOST_LOST = 4
"""Number of lost writes that, with more than a tenth of all lost, shows a board without a request queue."""
_NOT_READ = object()
"""Result for a board silent about a record, as some are for a missing id."""


class RecordWriter:
    """Sends the writes of an import in passes, and records the resulting content of the board in `reader`.

    A write is repeated only after a later reading without the record: the board handles requests in order, so the
    write was lost and will not be done any more.
    """

    def __init__(
        self,
        board: BoardConnection,
        reader: BoardReader,
        on_progress: ProgressCallback,
        is_exclusive: Callable[[], Awaitable[bool]],
        *,
        unchecked: bool,
    ) -> None:
        """Send writes through `board`, and record the outcomes in `reader`.

        `is_alone` is called now and then, and returns False after a change of the project id by another program;
        `is_alone` may raise ProjectError.
        """
        self.refused: set[str] = set()
        """Items of the latest pass refused by the board."""
        self.doubtful: set[RecordType[Any]] = set()
        """Types with an unproved write in the latest pass: only the lists show the outcome."""
        self.is_suspicious = False
        """Whether records other than the written records may have changed.

        True after a write with success reported but no effect in a reading, as the write may have been damaged on the
        way, and after a change of the project id by another program.
        """
        self._board = board
        self._reader = reader
        self._on_progress = on_progress
        self._is_exclusive = is_exclusive
        self._listed: Collection[RecordType[Any]] = ()
        self._unchecked = unchecked
        self._depth = board.connection.write_depth_bound
        self._sent = self._lost = self._done = self._total = 0
        self._next_check = _CHECK_EVERY
        self._one_by_one = asyncio.Lock()

    async def run(self, stages: Sequence[Sequence[Write]], listed: Collection[RecordType[Any]]) -> None:
        """Send all writes, stage by stage. The lists of the types `listed` will be read afterwards in any case."""
        self.refused, self.doubtful, self._listed = set(), set(), listed
        self.is_suspicious = False
        self._done, self._total = 0, sum(map(len, stages))
        for stage in stages:
            await in_parallel(stage, self._write, self._depth)
        self._on_progress(Progress("writing", self._total, self._total, stages[-1][-1].item))

    async def _write(self, write: Write) -> None:
        if self._sent >= self._next_check:
            self._next_check = self._sent + _CHECK_EVERY
            if not await self._is_exclusive():
                self.is_suspicious = True
        self._on_progress(Progress("writing", self._done, self._total, write.item))
        if self._queues():
            await self._write_one(write)
        else:
            async with self._one_by_one:
                await self._write_one(write)
        self._done += 1

    def _queues(self) -> bool:
        """Return whether the board seems to queue requests received before the previous response."""
        return self._depth > 1 and (self._lost < _MOST_LOST or self._lost * 10 < self._sent)

    async def _write_one(self, write: Write) -> None:
        if write.record_type is None:
            if await self._send(write) == 0:
                self.refused.add(write.item)
        elif write.record is None:
            await self._delete(write, write.record_type)
        else:
            await self._add(write, write.record_type)

    async def _add(self, write: Write, record_type: RecordType[Any]) -> None:
        key = record_type, write.record_id
        for _ in range(_TRIES):
            result, found = await self._send_and_read(write, record_type)
            self._reader.records[key] = None if found is _NOT_READ else found
            if found == write.record:
                return
            self.doubtful.add(record_type)
            if result == 0:
                self.refused.add(write.item)
                return
            if found is _NOT_READ:
                return
            if found is not None or result is not None:
                self.is_suspicious = self.is_suspicious or found is None
                return

    async def _send_and_read(self, write: Write, record_type: RecordType[Any]) -> tuple[int | None, Any]:
        """Return the result of an addition (None: no response), and the record read back afterwards."""
        if self._queues():
            # Both leave in this order without waiting for each other, so the reading makes the result exact.
            outcome = await asyncio.gather(
                self._send(write), self._read(record_type, write.record_id), return_exceptions=True
            )
            for each in outcome:
                if isinstance(each, BaseException):
                    raise each
            result, found = outcome
            if found == write.record:
                return result, found  # type: ignore[return-value]  # no exception is left
        else:
            result = await self._send(write)
        # A reading sent beside the write may have been answered first. The next reading follows the write.
        return result, await self._read(record_type, write.record_id)  # type: ignore[return-value]  # the same

    async def _delete(self, write: Write, record_type: RecordType[Any]) -> None:
        """Delete a record. The list proves the deletion, and of no other record; without a list, a query does."""
        key = record_type, write.record_id
        for _ in range(_TRIES):
            result = await self._send(write)
            self._reader.records[key] = None
            if result == 1 and (record_type in self._listed or record_type in self.doubtful):
                return
            found = await self._read(record_type, write.record_id)
            if found is None and result == 1:
                return
            self.doubtful.add(record_type)
            if found is _NOT_READ or found is None:
                return
            self._reader.records[key] = found
            if result == 0:
                self.refused.add(write.item)
            if result is not None:
                self.is_suspicious = self.is_suspicious or result == 1
                return

    async def _send(self, write: Write) -> int | None:
        """Send a write once; return the result, None without a response."""
        self._sent += 1
        try:
            return (await self._board.request(write.request, unchecked=self._unchecked)).result
        except OutcomeUnknown:
            self._lost += 1
            return None

    async def _read(self, record_type: RecordType[Any], record_id: int) -> Any:
        try:
            return await self._reader.query(record_type, record_id)
        except RequestTimeout:
            return _NOT_READ
