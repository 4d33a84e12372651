"""The three kinds of records that are listed, read, added and deleted one by one, and their packets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

from servolink.protocol import editing, joystick
from servolink.protocol.packet import Query, Request, Response, Result
from servolink.protocol.records import Action, JoystickTable, Macro

Record: TypeAlias = Action | Macro | JoystickTable


@dataclass(frozen=True, slots=True)
class RecordType:
    """One kind of records."""

    word: str
    """What people call one."""
    plural: str
    """The field of `Project`, which is also what `servolink` commands are called."""
    record: type[Any]
    listing: Query[Any]
    querying: type[Query[Any]]
    adding: type[Request[Result]]
    deleting: type[Request[Result]]

    def of(self, project: Any) -> dict[int, Any]:
        """Return the records of this kind in `project`, by id."""
        return {self.id_of(record): record for record in getattr(project, self.plural)}

    def id_of(self, record: Any) -> int:
        """Return the id of a record or of its entry in a list, which is its first field."""
        return int(getattr(record, record.__struct_fields__[0]))

    def caption_of(self, record: Any) -> str:
        """Return the caption, which is the second field."""
        return str(getattr(record, record.__struct_fields__[1]))

    def listed(self, response: Response) -> tuple[int, ...]:
        """Return the ids in the board's list, in its order; an id may be there twice."""
        (entries,) = (getattr(response, name) for name in response.__struct_fields__)
        return tuple(self.id_of(entry) for entry in entries)

    def found(self, response: Response) -> Any | None:
        """Return the record in the answer to a query, None if the board has none."""
        values = [getattr(response, name) for name in self.record.__struct_fields__]
        return self.record(*values) if values[0] else None

    def query(self, record_id: int) -> Query[Any]:
        """Return the request that asks for a record."""
        (field,) = self.querying.__struct_fields__
        return self.querying(**{field: record_id})

    def add(self, record: Any) -> Request[Result]:
        """Return the request that stores `record`."""
        return self.adding(*(getattr(record, name) for name in self.record.__struct_fields__))

    def delete(self, record_id: int) -> Request[Result]:
        """Return the request that deletes a record."""
        (field,) = self.deleting.__struct_fields__
        return self.deleting(**{field: record_id})


ACTION = RecordType(
    "action",
    "actions",
    Action,
    editing.QueryActionListRequest(),
    editing.QueryActionRequest,
    editing.AddActionRequest,
    editing.DeleteActionRequest,
)
MACRO = RecordType(
    "macro",
    "macros",
    Macro,
    editing.QueryMacroListRequest(),
    editing.QueryMacroRequest,
    editing.AddMacroRequest,
    editing.DeleteMacroRequest,
)
TABLE = RecordType(
    "joystick table",
    "joystick_tables",
    JoystickTable,
    joystick.QueryJoystickTableListRequest(),
    joystick.QueryJoystickTableRequest,
    joystick.AddJoystickTableRequest,
    joystick.DeleteJoystickTableRequest,
)

RECORD_TYPES = (ACTION, MACRO, TABLE)
"""In the order in which they are written: what a record calls is there before it."""
