"""Everything stored on a board, read until two consecutive readings agree.

The frame's sum has 8 bits: on a bad line it lets a damaged answer through now and then. Two readings that are
damaged alike are another matter (see docs/limits.md for the figures).
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from servolink.errors import ConnectionLost, DecodeError, ProjectError
from servolink.escaping import escape
from servolink.project.model import Project, without_neutral
from servolink.project.records import total_size
from servolink.project.transfer.results import Phase, Progress, ProgressCallback
from servolink.protocol.codec import Codec
from servolink.protocol.editing import QueryProjectIDRequest, QueryServoParameterRequest
from servolink.protocol.joystick import QueryActiveJoystickTableRequest
from servolink.protocol.packet import Request, Response
from servolink.protocol.record_types import RECORD_TYPES, RecordType, stored_size
from servolink.protocol.records import ServoParameter


class PinnedConnection:
    """Passes on what a board is asked; ConnectionLost once its connection is another one, even to the same address."""

    def __init__(self, board: BoardConnection) -> None:
        """Speak to `board` through the connection that it has now."""
        self._board = board
        self.connection = board.connection

    @property
    def url(self) -> str:
        """Its address."""
        return self._board.url

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding of the connection."""
        return self._board.codec

    async def request(self, packet: Request[R], *, unchecked: bool = False) -> R:
        """Return the answer to `packet`."""
        return await self._still().request(packet, unchecked=unchecked)

    async def write_project_id(self, project_id: int) -> None:
        """Write the project id."""
        await self._still().write_project_id(project_id)

    async def clear_all_data(self) -> None:
        """Delete everything."""
        await self._still().clear_all_data()

    def _still(self) -> BoardConnection:
        if self._board.connection is not self.connection:
            raise ConnectionLost(
                f"the connection to {self.url} was lost and came back in the middle of this, perhaps to "
                "another board; do it again"
            )
        return self._board


T = TypeVar("T")
R = TypeVar("R", bound=Response)

_READINGS = 8
"""How many readings of one thing may differ before it is given up."""


class BoardConnection(Protocol):
    """A connected board, as far as projects need one."""

    @property
    def url(self) -> str:
        """Its address."""
        ...

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding of the connection."""
        ...

    @property
    def connection(self) -> object:
        """What stands for its connection: another one after a loss."""
        ...

    async def request(self, packet: Request[R], *, unchecked: bool = False) -> R:
        """Return the answer to `packet`."""
        ...

    async def write_project_id(self, project_id: int) -> None:
        """Write the project id."""

    async def clear_all_data(self) -> None:
        """Delete everything."""


@dataclass(frozen=True, slots=True)
class Listed:
    """One entry of a list on the board."""

    record_id: int
    record: Any | None
    """What the board gives under this id; None if it gives nothing, or what cannot be understood."""


@dataclass
class Content:
    """What is on a board, sound or not; nothing by default."""

    project_id: int = 0
    servo_parameters: tuple[ServoParameter, ...] = ()
    active: int | None = None
    records: dict[RecordType[Any], tuple[Listed, ...]] = field(default_factory=lambda: dict.fromkeys(RECORD_TYPES, ()))
    """In the order of the board's lists, with ids that are there twice."""

    def project(self) -> Project:
        """Return it as a project; ProjectError if the board lists what it does not give."""
        for kind, entries in self.records.items():
            for entry in entries:
                if entry.record is None:
                    raise ProjectError(
                        f"{kind.label} {entry.record_id}: the board lists it and does not give it, or gives what is "
                        f"no {kind.label}; delete it there, or go on without keeping what the board has"
                    )
        return self.readable()

    def readable(self) -> Project:
        """Return as a project what the board gives, without what it only lists."""
        records = {
            kind.field: tuple({one.record_id: one.record for one in entries if one.record is not None}.values())
            for kind, entries in self.records.items()
        }
        parameters = tuple({one.servo_id: one for one in self.servo_parameters}.values())
        return Project(self.project_id, parameters, active_joystick_table=self.active, **records).sorted()

    def doubled(self) -> list[str]:
        """Return what is listed more than once, of which a board gives only one."""
        listed = {kind.label: [entry.record_id for entry in entries] for kind, entries in self.records.items()}
        listed["servo parameter"] = [one.servo_id for one in self.servo_parameters]
        return [
            f"{word} {record_id}"
            for word, ids in listed.items()
            for record_id, times in sorted(Counter(ids).items())
            if times > 1
        ]

    def missing(self) -> list[str]:
        """Return what is listed and not given."""
        return [
            f"{kind.label} {entry.record_id}"
            for kind, entries in self.records.items()
            for entry in entries
            if entry.record is None
        ]

    def is_empty(self) -> bool:
        """Tell whether nothing is stored but, perhaps, the project id."""
        return not any(self.records.values()) and not without_neutral(self.servo_parameters)

    def growth(self, project: Project) -> int:
        """Return how many bytes `project` takes more than what is there and goes."""
        records = [entry.record for entries in self.records.values() for entry in entries if entry.record is not None]
        kept = {one.servo_id for one in without_neutral(project.servo_parameters)}
        neutral = [one for one in self.servo_parameters if one.servo_id not in kept]
        stored = sum(map(stored_size, (*self.servo_parameters, *records)))
        return total_size(project) + sum(map(stored_size, neutral)) - stored


async def read_project(board: BoardConnection, on_progress: ProgressCallback) -> Project:
    """Return everything stored on the board; ProjectError if the readings never agree or it is not sound."""
    content = await read_content(board, on_progress)
    if doubled := content.doubled():
        logging.getLogger(__name__).warning("%s lists twice and gives once: %s", escape(board.url), ", ".join(doubled))
    return content.project()


async def read_content(board: BoardConnection, on_progress: ProgressCallback, phase: Phase = "reading") -> Content:
    """Return what is on the board, each part read until two consecutive readings agree; progress names `phase`."""
    for _ in range(_READINGS):
        content = await _agreed(board, _read_outline, "its lists")
        ids = {kind: content.records[kind] for kind in RECORD_TYPES}
        total, done = sum(map(len, ids.values())), 0
        on_progress(Progress(phase, 0, total, "lists"))
        known: dict[tuple[RecordType[Any], int], Any] = {}
        for kind, entries in ids.items():
            for entry in entries:
                if (kind, entry.record_id) not in known:
                    known[kind, entry.record_id] = await _read_record(board, kind, entry.record_id)
                done += 1
                on_progress(Progress(phase, done, total, f"{kind.label} {entry.record_id}"))
        if await _read_outline(board) == content:
            content.records = {
                kind: tuple(Listed(entry.record_id, known[kind, entry.record_id]) for entry in entries)
                for kind, entries in ids.items()
            }
            return content
    raise ProjectError(f"{board.url}: what is on the board kept changing while it was read; is another "
                       "program using it?")  # fmt: skip


async def read_project_id(board: BoardConnection) -> int:
    """Return the project id, read until two consecutive readings agree."""
    return await _agreed(board, _project_id, "the project id")


async def _project_id(board: BoardConnection) -> int:
    return (await board.request(QueryProjectIDRequest())).project_id


async def _read_outline(board: BoardConnection) -> Content:
    """Read all but the records themselves."""
    return Content(
        project_id=await _project_id(board),
        servo_parameters=(await board.request(QueryServoParameterRequest())).servos,
        active=(await board.request(QueryActiveJoystickTableRequest())).table_id or None,
        records={
            kind: tuple(Listed(listed, None) for listed in kind.ids_in(await board.request(kind.list_request)))
            for kind in RECORD_TYPES
        },
    )


async def _read_record(board: BoardConnection, kind: RecordType[Any], record_id: int) -> Any | None:
    async def read(board: BoardConnection) -> Any | None:
        try:
            return kind.record_in(await board.request(kind.query(record_id)))
        except DecodeError:
            return None

    return await _agreed(board, read, f"{kind.label} {record_id}")


async def _agreed(board: BoardConnection, read: Callable[[BoardConnection], Awaitable[T]], what: str) -> T:
    before = await read(board)
    for _ in range(_READINGS):
        now = await read(board)
        if now == before:
            return now
        before = now
    raise ProjectError(
        f"{board.url}: {_READINGS + 1} readings of {what} all differed from the one before; the line is "
        "too bad, or another program is using the board"
    )
