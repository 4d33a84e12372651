"""Reading of a board: each part once if as expected, else until two consecutive readings agree.

The checksum of a frame has 8 bits: on a bad line, now and then a damaged response is accepted (docs/limits.md has the
figures). Damage never turns a record into exactly the expected record, so an expected reading is proof. Any other
part must be read twice with the same result: the part will be changed, deleted or saved in a file.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Awaitable, Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias, TypeVar

from servolink.errors import DecodeError, ProjectError, escape
from servolink.project.model import Project, stored_size, without_neutral
from servolink.project.transfer.pinned import BoardConnection, in_parallel
from servolink.project.transfer.results import Phase, Progress, ProgressCallback
from servolink.protocol import (
    RECORD_TYPES,
    QueryActiveJoystickTableRequest,
    QueryProjectIDRequest,
    QueryServoParameterRequest,
    RecordType,
    ServoParameter,
)


@dataclass(frozen=True, slots=True)
class Listed:
    """Entry of a list on the board, with the record."""

    record_id: int
    record: Any | None
    """Record returned by the board for this id; None for a missing record, or a record impossible to decode."""


@dataclass
class Content:
    """Everything on a board; nothing by default."""

    project_id: int = 0
    servo_parameters: tuple[ServoParameter, ...] = ()
    active: int | None = None
    records: dict[RecordType[Any], tuple[Listed, ...]] = field(default_factory=lambda: dict.fromkeys(RECORD_TYPES, ()))
    """Records in the order of the board's lists, with duplicate ids."""

    def project(self) -> Project:
        """Return the content as a project. Raise ProjectError for a listed record that the board does not return."""
        for record_type, entries in self.records.items():
            for entry in entries:
                if entry.record is None:
                    raise ProjectError(
                        f"{record_type} {entry.record_id}: the board lists the record, but returns nothing or "
                        f"no valid {record_type}; delete the record on the board, or continue without a backup of the "
                        "board"
                    )
        return self.readable()

    def readable(self) -> Project:
        """Return all records returned by the board as a project, without records only listed."""
        records = {
            record_type.field: tuple({one.record_id: one.record for one in entries if one.record is not None}.values())
            for record_type, entries in self.records.items()
        }
        parameters = tuple({one.servo_id: one for one in self.servo_parameters}.values())
        return Project(self.project_id, parameters, active_joystick_table=self.active, **records).sorted()

    def doubled(self) -> list[str]:
        """Return the names of all items listed more than once; a board returns only a single copy."""
        listed = {str(record_type): self.ids_of(record_type) for record_type in self.records}
        listed["servo parameter"] = [one.servo_id for one in self.servo_parameters]
        return [
            f"{label} {record_id}"
            for label, ids in listed.items()
            for record_id, times in sorted(Counter(ids).items())
            if times > 1
        ]

    def missing(self) -> list[str]:
        """Return the names of all records listed but not returned."""
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
        """Return whether nothing is stored except, perhaps, the project id."""
        return not any(self.records.values()) and not without_neutral(self.servo_parameters)

    def growth(self, project: Project) -> int:
        """Return the number of bytes that `project` takes beyond the replaced content."""
        records = [entry.record for entries in self.records.values() for entry in entries if entry.record is not None]
        servo_ids = {one.servo_id for one in without_neutral(project.servo_parameters)}
        neutral = [one for one in self.servo_parameters if one.servo_id not in servo_ids]
        stored = sum(map(stored_size, (*self.servo_parameters, *records)))
        return project.total_size() + sum(map(stored_size, neutral)) - stored


T = TypeVar("T")
Key: TypeAlias = "tuple[RecordType[Any], int]"
"""Type and id of a record."""

_READINGS = 8
"""Maximum number of readings different from the previous reading."""
_NOTHING_EXPECTED = object()


class Outline(NamedTuple):
    """Everything on a board except the records."""

    project_id: int
    servo_parameters: tuple[ServoParameter, ...]
    active: int | None


async def export_project(board: BoardConnection, on_progress: ProgressCallback) -> Project:
    """Return everything stored on the board, each part after two consistent readings.

    Raise ProjectError if the readings never agree, or if the board does not return a listed record.
    """
    content = await BoardReader(board, on_progress).read()
    if doubled := content.doubled():
        logging.getLogger(__name__).warning(
            "%s lists twice and returns once: %s", escape(board.url), ", ".join(doubled)
        )
    return content.project()


async def read_project_id(board: BoardConnection, expected: object = _NOTHING_EXPECTED) -> int:
    """Return the project id, from two equal readings, or from a single reading equal to `expected`.

    The id of a board that does not tell it is 0.
    """
    if "QueryProjectID" in getattr(board, "unanswered", ()):
        return 0

    async def read() -> int:
        return (await board.request(QueryProjectIDRequest())).project_id

    return await _agreed(board, read, "the project id", expected)


class BoardReader:
    """Reads a board and remembers the records: a record once read or written need not be read again."""

    def __init__(self, board: BoardConnection, on_progress: ProgressCallback, target: Project | None = None) -> None:
        """Read `board`, expected to hold `target`; None expects nothing."""
        self.records: dict[Key, Any | None] = {}
        """Records with proved content; None for a missing record."""
        self._board = board
        self._depth = board.connection.depth_bound
        self._on_progress = on_progress
        self._target = None if target is None else target.sorted()
        self._expected: Mapping[RecordType[Any], Mapping[int, Any]] = {
            record_type: {} if self._target is None else record_type.by_id(self._target) for record_type in RECORD_TYPES
        }
        self._lists: dict[RecordType[Any], tuple[Any, ...]] = dict.fromkeys(RECORD_TYPES, ())
        self._compares_captions = True

    # --- everything ---------------------------------------------------------------------------------------------

    async def read(self, phase: Phase = "reading", project_id: object = _NOTHING_EXPECTED) -> Content:
        """Read everything, expecting `project_id`. Raise ProjectError for ever-changing ids or readings."""
        for _ in range(_READINGS):
            outline = await self._read_outline(self._expect(project_id))
            self.records.clear()
            await in_parallel(RECORD_TYPES, self._read_list, self._depth)
            keys = self._listed_keys()
            self._on_progress(Progress(phase, 0, len(keys), "lists"))
            await self._read_records(phase, keys)
            if doubtful := [each for each in RECORD_TYPES if self._is_doubtful(each)]:
                await self._confirm_lists(phase, doubtful)
                self._compare_captions_no_more()
            # A program that imports meanwhile changes the project id before anything else.
            if await read_project_id(self._board, outline.project_id) != outline.project_id:
                continue
            if self._target is not None or await self._read_outline(outline) == outline:
                return self._content(outline)
        raise ProjectError(
            f"{self._board.url}: the content kept changing during the reading; is another program using the board?"
        )

    async def check(self, phase: Phase, project_id: int, types: Collection[RecordType[Any]]) -> Content:
        """Return the content after a write of records: the records are known, so only `types` are listed again."""
        outline = await self._read_outline(self._expect(project_id))
        self._on_progress(Progress(phase, 0, len(types), "lists"))
        for record_type in RECORD_TYPES:
            self._lists[record_type] = tuple(
                record for (each, _), record in self.records.items() if each is record_type and record is not None
            )
        await in_parallel([each for each in RECORD_TYPES if each in types], self._read_list, self._depth)
        # A deleted record still listed is unknown again, like a new record.
        await self._read_records(phase, [key for key in self._listed_keys() if self.records.get(key) is None])
        if doubtful := [each for each in types if self._is_doubtful(each)]:
            await self._confirm_lists(phase, doubtful)
            await self._read_records(phase, [key for each in RECORD_TYPES for key in self._differing(each)])
            self._compare_captions_no_more()
        return self._content(outline)

    def _content(self, outline: Outline) -> Content:
        records = {
            record_type: tuple(
                Listed(record_id, self.records.get((record_type, record_id)))
                for record_id in map(record_type.id_of, entries)
            )
            for record_type, entries in self._lists.items()
        }
        return Content(*outline, records)

    def _expect(self, project_id: object) -> tuple[object, object, object]:
        """Return the expected outline; parts without an expectation need two readings."""
        if self._target is None:
            return project_id, _NOTHING_EXPECTED, _NOTHING_EXPECTED
        return project_id, self._target.servo_parameters, self._target.active_joystick_table

    async def _read_outline(self, expected: tuple[object, object, object]) -> Outline:
        return Outline(
            await read_project_id(self._board, expected[0]),
            await self._read_parameters(expected[1]),
            await self._read_active(expected[2]),
        )

    async def _read_parameters(self, expected: object) -> tuple[ServoParameter, ...]:
        async def read() -> tuple[ServoParameter, ...]:
            return (await self._board.request(QueryServoParameterRequest())).servos

        return await _agreed(self._board, read, "the servo parameters", expected)

    async def _read_active(self, expected: object) -> int | None:
        async def read() -> int | None:
            return (await self._board.request(QueryActiveJoystickTableRequest())).table_id or None

        return await _agreed(self._board, read, "the active joystick table", expected)

    # --- lists --------------------------------------------------------------------------------------------------

    async def _read_list(self, record_type: RecordType[Any]) -> None:
        self._lists[record_type] = await self._query_list(record_type)

    async def _query_list(self, record_type: RecordType[Any]) -> tuple[Any, ...]:
        return record_type.entries_in(await self._board.request(record_type.list_request))

    def _is_doubtful(self, record_type: RecordType[Any]) -> bool:
        """Return whether a single reading of a list is not enough.

        A single reading is enough if the board returns each record of the list, with the caption as in the list. For an
        export, a single reading is never enough.
        """
        ids = [record_type.id_of(entry) for entry in self._lists[record_type]]
        return self._target is None or len(set(ids)) < len(ids) or bool(self._differing(record_type))

    def _differing(self, record_type: RecordType[Any]) -> list[Key]:
        """Return the listed records that are missing, or have another caption than in the list, each once."""
        found = dict[Key, None]()
        for entry in self._lists[record_type]:
            record = self.records.get(key := (record_type, record_type.id_of(entry)))
            if record is None or (
                self._compares_captions and record_type.caption_of(record) != record_type.caption_of(entry)
            ):
                found[key] = None
        return list(found)

    def _compare_captions_no_more(self) -> None:
        """Ignore the captions in lists if different from the captions of records even after two readings."""
        if any(self.records.get(key) is not None for each in RECORD_TYPES for key in self._differing(each)):
            self._compares_captions = False

    async def _confirm_lists(self, phase: Phase, types: Iterable[RecordType[Any]]) -> None:
        """Read the lists of `types` until two consecutive readings agree, and then the new records listed."""
        for record_type in types:

            async def read(record_type: RecordType[Any] = record_type) -> tuple[Any, ...]:
                return await self._query_list(record_type)

            first = self._lists[record_type]
            self._lists[record_type] = await _agreed(self._board, read, f"the list of {record_type}s", first)
        await self._read_records(phase, [key for key in self._listed_keys() if key not in self.records])

    def _listed_keys(self) -> list[Key]:
        """Return type and id of all listed records, each once."""
        keys = [(each, each.id_of(entry)) for each, entries in self._lists.items() for entry in entries]
        return list(dict.fromkeys(keys))

    # --- records ------------------------------------------------------------------------------------------------

    async def query(self, record_type: RecordType[Any], record_id: int) -> Any | None:
        """Read a record once; return None for a missing record, or a record impossible to decode."""
        try:
            found = record_type.record_in(await self._board.request(record_type.query(record_id)))
        except DecodeError:
            return None
        return found

    async def _read_records(self, phase: Phase, keys: list[Key]) -> None:
        done = 0

        async def read(key: Key) -> None:
            nonlocal done
            record_type, record_id = key

            async def query() -> Any | None:
                return await self.query(record_type, record_id)

            expected = self._expected[record_type].get(record_id, _NOTHING_EXPECTED)
            self.records[key] = await _agreed(self._board, query, f"{record_type} {record_id}", expected)
            done += 1
            self._on_progress(Progress(phase, done, len(keys), f"{record_type} {record_id}"))

        await in_parallel(keys, read, self._depth)


async def _agreed(
    board: BoardConnection, read: Callable[[], Awaitable[T]], what: str, expected: object = _NOTHING_EXPECTED
) -> T:
    """Return a reading equal to `expected` or to the previous reading."""
    before = await read()
    if before == expected:
        return before
    for _ in range(_READINGS):
        now = await read()
        if now in (before, expected):
            return now
        before = now
    raise ProjectError(
        f"{board.url}: {_READINGS + 1} readings of {what} all differed from the previous reading; the line is "
        "too bad, or another program is using the board"
    )


def doubled_types(content: Content) -> set[RecordType[Any]]:
    """Return the types of records listed more than once."""
    return {each for each in RECORD_TYPES if any(times > 1 for times in Counter(content.ids_of(each)).values())}
