"""Writing records: several requests under way, each write with a reading behind it that decides what became of it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection, Sequence
from typing import Any

from servolink.errors import OutcomeUnknown, RequestTimeout
from servolink.project.transfer.pinned import BoardConnection, in_parallel
from servolink.project.transfer.read import BoardReader
from servolink.project.transfer.results import Progress, ProgressCallback
from servolink.project.transfer.writes import Write
from servolink.protocol.record_types import RecordType

_TRIES = 4
"""How many times one record is written in a pass, if a reading shows each time that it was lost."""
_CHECK_EVERY = 64
"""Writes, after which the marker is looked at: another program may have begun to import."""
_MOST_LOST = 4
"""So many lost writes, and more than a tenth of all, mean that the board does not queue what it is sent."""
_NOT_READ = object()
"""The board stays silent when it is asked for the record, as some do for an id that they do not have."""


class RecordWriter:
    """Sends the writes of an import in passes, and notes in `reader` what the board holds afterwards.

    A write is sent again only after a reading that was sent behind it shows that the board does not hold the record:
    the board handles requests in order, so the write was lost and will not be done any more.
    """

    def __init__(
        self,
        board: BoardConnection,
        reader: BoardReader,
        on_progress: ProgressCallback,
        is_alone: Callable[[], Awaitable[bool]],
        *,
        unchecked: bool,
    ) -> None:
        """`is_alone` is asked now and then: False if somebody has changed the project id; it may raise ProjectError."""
        self.refused: set[str] = set()
        """Items of the latest pass that the board refused."""
        self.doubtful: set[RecordType[Any]] = set()
        """Types of which a write of the latest pass was not proved at once: only their lists show the outcome."""
        self.is_suspicious = False
        """Whether another record than the written ones may have changed.

        That is if the board said of a write that it was done and a reading shows nothing of it, as the write may have
        been damaged on its way, and if somebody else has changed the project id.
        """
        self._board = board
        self._reader = reader
        self._on_progress = on_progress
        self._is_alone = is_alone
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
            if not await self._is_alone():
                self.is_suspicious = True
        self._on_progress(Progress("writing", self._done, self._total, write.item))
        if self._queues():
            await self._write_one(write)
        else:
            async with self._one_by_one:
                await self._write_one(write)
        self._done += 1

    def _queues(self) -> bool:
        """Return whether the board seems to keep requests that come before it has answered the one before."""
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
            self._reader.known[key] = None if found is _NOT_READ else found
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
        """Return the result of an addition, None if there was none, and the record that is there after it."""
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
        # A reading that was sent beside the write may have come before it. This one is sent after it is over.
        return result, await self._read(record_type, write.record_id)  # type: ignore[return-value]  # the same

    async def _delete(self, write: Write, record_type: RecordType[Any]) -> None:
        """Delete a record. Its list proves that it is gone, and no other, or a reading where no list will be read."""
        key = record_type, write.record_id
        for _ in range(_TRIES):
            result = await self._send(write)
            self._reader.known[key] = None
            if result == 1 and (record_type in self._listed or record_type in self.doubtful):
                return
            found = await self._read(record_type, write.record_id)
            if found is None and result == 1:
                return
            self.doubtful.add(record_type)
            if found is _NOT_READ or found is None:
                return
            self._reader.known[key] = found
            if result == 0:
                self.refused.add(write.item)
            if result is not None:
                self.is_suspicious = self.is_suspicious or result == 1
                return

    async def _send(self, write: Write) -> int | None:
        """Send a write once; return its result, None if no response came."""
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
