"""Records stored on a board (3.3, 3.4): actions, macros, joystick tables and the parameters of servos."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from servolink.client.captions import record_id as id_of_record
from servolink.client.session import Session
from servolink.errors import EncodeError, NotFound, quote
from servolink.protocol import (
    RECORD_TYPES,
    TABLE,
    AddServoParameterRequest,
    ClearAllDataRequest,
    Packet,
    QueryActiveJoystickTableRequest,
    QueryServoParameterRequest,
    RecordRef,
    RecordType,
    ServoParameter,
    SetActiveJoystickTableRequest,
    WriteProjectIDRequest,
)

T = TypeVar("T", bound=Struct)

_NOT_STORED = "its memory may be full, or the id may be taken"


class RecordStore:
    """Reads and changes the records of a board, of all types, and reads changes back."""

    def __init__(self, session: Session) -> None:
        """Ask through `session`."""
        self._session = session
        self._adding = asyncio.Lock()

    async def entries(self, record_type: RecordType[Any]) -> tuple[Any, ...]:
        """Return id and caption of each record of a type."""
        return record_type.entries_in(await self._session.request(record_type.list_request))

    async def id_of(self, record_type: RecordType[Any], record: int | str, *, must_exist: bool = False) -> int:
        """Return the id of a record given by id or caption (see `servolink.client.captions`)."""
        return await id_of_record(self._session, record_type, record, must_exist=must_exist)

    async def get(self, record_type: RecordType[T], record: int | str) -> T:
        """Return a record. Raise NotFound if the board has none with this id or caption."""
        record_id = await self.id_of(record_type, record)
        found = await self._find(record_type, record_id)
        if found is None:
            raise NotFound(f"the board has no {record_type} {record_id}", record_type.query(record_id))
        return found

    async def add(self, record_type: RecordType[T], record: T) -> T:
        """Store a record and return it as stored: with the lowest free id if its id was 0.

        Raise EncodeError if it refers to a record without an id, Rejected if the board refuses.
        """
        if not isinstance(record, record_type.record_class):
            raise TypeError(f"the record must be of type {record_type.record_class.__name__}, not {quote(record)}")
        _check_references(record_type, record)
        async with self._adding:  # or two concurrent calls would get the same id
            if record_type.id_of(record) == 0:
                record = replace(record, **{record.__struct_fields__[0]: await self._free_id(record_type)})
            await self._session.command(record_type.add(record), _NOT_STORED)
        return record

    async def delete(self, record_type: RecordType[Any], record: int | str) -> None:
        """Delete a record. Raise Rejected if there is none."""
        record_id = await self.id_of(record_type, record)
        await self._session.command(record_type.delete(record_id), f"it may have no such {record_type}")

    async def servo_parameters(self) -> tuple[ServoParameter, ...]:
        """Return caption and angle correction of each servo (3.3.10)."""
        return (await self._session.request(QueryServoParameterRequest())).servos

    async def add_servo_parameters(self, servos: Iterable[ServoParameter]) -> None:
        """Store caption and angle correction of servos (3.3.11). Raise Rejected if the board refuses."""
        request = AddServoParameterRequest(tuple(servos))
        await self._session.command(request, "the memory may be full, or the servo absent")

    async def set_active_table(self, table: int | str) -> None:
        """Activate a joystick table (3.4.5). Raise Rejected for a missing table."""
        request = SetActiveJoystickTableRequest(await self.id_of(TABLE, table))
        await self._session.command(request, "it may have no such joystick table")

    async def active_table(self) -> int | None:
        """Return the id of the active joystick table, None if the board has no table (3.4.6)."""
        return (await self._session.request(QueryActiveJoystickTableRequest())).table_id or None

    async def took_effect(self, request: Packet) -> bool | None:
        """Return whether the board is in the state after `request` (see `Board.took_effect`)."""
        for record_type in RECORD_TYPES:
            if isinstance(request, record_type.add_class):
                record = record_type.record_in(request)
                return record is not None and await self._find(record_type, record_type.id_of(request)) == record
            if isinstance(request, record_type.delete_class):
                return await self._find(record_type, record_type.id_of(request)) is None
        match request:
            case AddServoParameterRequest():
                return set(request.servos) <= set(await self.servo_parameters())
            case WriteProjectIDRequest():
                project_id = await self._session.find_project_id()
                return None if project_id is None else project_id == request.project_id
            case SetActiveJoystickTableRequest():
                return (await self.active_table() or 0) == request.table_id
            case ClearAllDataRequest():
                return not any([await self.entries(record_type) for record_type in RECORD_TYPES])
            case _:
                return None

    async def _find(self, record_type: RecordType[T], record_id: int) -> T | None:
        found = record_type.record_in(await self._session.request(record_type.query(record_id)))
        return found if found is not None and record_type.id_of(found) == record_id else None

    async def _free_id(self, record_type: RecordType[Any]) -> int:
        used_ids = {record_type.id_of(entry) for entry in await self.entries(record_type)}
        return next(record_id for record_id in range(1, len(used_ids) + 2) if record_id not in used_ids)


def _check_references(record_type: RecordType[T], record: T) -> None:
    """Raise EncodeError if `record` refers by object to a record without an id."""
    for target, record_id in record_type.references(record):
        if isinstance(record_id, RecordRef) and record_id == 0:
            caption = target.caption_of(record_id.record)
            raise EncodeError(
                f"{record_type} {quote(record_type.caption_of(record))} refers to {target} {quote(caption)}, which has "
                f"no id: add that first, and refer to the {target} that add_{target} returns"
            )
