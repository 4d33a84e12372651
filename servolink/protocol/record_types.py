"""Types of stored records, with packets, references to other records, and sizes in bytes.

All layers loop over `RECORD_TYPES`; a new type of record is a further entry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Generic, TypeAlias, TypeVar

from msgspec import Struct
from msgspec.structs import astuple, replace

from servolink.errors import ProjectError, quote
from servolink.protocol import editing, joystick
from servolink.protocol.codec import PACKETS
from servolink.protocol.layouts import layout
from servolink.protocol.packet import Packet, Query, Request, Response, Result
from servolink.protocol.records import (
    Action,
    Button,
    JoystickTable,
    Macro,
    MacroCommand,
    MacroCommandType,
    ServoParameter,
)

Record: TypeAlias = Action | Macro | JoystickTable
T = TypeVar("T", bound=Struct)


class StoredType(Struct, Generic[T], frozen=True, eq=False):
    """Type of object stored by a board, with the id as the first field."""

    label: str
    """Name for people, such as `joystick table`."""
    field: str
    """Field of `Project` with all objects of the type."""
    record_class: type[T]
    add_class: type[Request[Result]]

    def __str__(self) -> str:
        """Return the label."""
        return self.label

    def by_id(self, project: Any) -> dict[int, T]:
        """Return the objects of this type in a `Project`, by id; for a duplicate id, the last object."""
        return {self.id_of(record): record for record in getattr(project, self.field)}

    def id_of(self, record: Struct) -> int:
        """Return the id of a record, a list entry, or a request to add a record."""
        return int(getattr(record, record.__struct_fields__[0]))

    def caption_of(self, record: Struct) -> str:
        """Return the caption of a record or of a list entry."""
        return str(getattr(record, next(name for name in record.__struct_fields__ if name.endswith("_caption"))))

    def size(self, record: T) -> int:
        """Return the bytes of `record` on the wire, and by assumption on the board.

        A board may keep a little more or less; the protocol cannot tell.
        """
        return layout(self.add_class, "little").rule.unit


class RecordType(StoredType[T], frozen=True, eq=False):
    """Type of record with a list, and with requests to query, add and delete a single record."""

    list_request: Query[Any]
    query_class: type[Query[Any]]
    delete_class: type[Request[Result]]
    links: Callable[[Any], Iterable[tuple[str, RecordType[Any]]]]
    """Fields of a part with the id of another record, each with the type of the other record."""

    @staticmethod
    def of(record: object) -> RecordType[Any]:
        """Return the type of an action, a macro or a joystick table. Raise ProjectError for anything else."""
        for record_type in RECORD_TYPES:
            if isinstance(record, record_type.record_class):
                return record_type
        raise ProjectError(f"{quote(record)} is not an action, a macro or a joystick table")

    def parts_of(self, record: Struct) -> tuple[Any, ...]:
        """Return the steps, commands or buttons of a record."""
        return tuple(getattr(record, record.__struct_fields__[-1]))

    def query(self, record_id: int) -> Query[Any]:
        """Return the request for a record."""
        (field,) = self.query_class.__struct_fields__
        return self.query_class(**{field: record_id})

    def add(self, record: T) -> Request[Result]:
        """Return the request to store `record`."""
        return self.add_class(*astuple(record))

    def delete(self, record_id: int) -> Request[Result]:
        """Return the request to delete a record."""
        (field,) = self.delete_class.__struct_fields__
        return self.delete_class(**{field: record_id})

    def entries_in(self, response: Response) -> tuple[Any, ...]:
        """Return the entries (id and caption) in the response to `list_request`."""
        return tuple(getattr(response, response.__struct_fields__[0]))

    def ids_in(self, response: Response) -> tuple[int, ...]:
        """Return the ids in the response to `list_request`, in the board's order; a board may list an id twice."""
        return tuple(map(self.id_of, self.entries_in(response)))

    def record_in(self, packet: Packet) -> T | None:
        """Return the record in the response to a query, or in the request to add a record; None for the id 0.

        A board without the record sends the id 0.
        """
        *others, parts = astuple(packet)
        return self.record_class(*others, tuple(parts)) if others[0] else None

    def references(self, record: T) -> Iterator[tuple[RecordType[Any], int]]:
        """Yield type and id of each record named in `record`; id 0 for a button without a macro."""
        for part in self.parts_of(record):
            for name, target in self.links(part):
                yield target, getattr(part, name)

    def with_references(self, record: T, new_id: Callable[[RecordType[Any], int], int]) -> T:
        """Return `record` with each reference replaced by `new_id(type, old id)`."""
        parts = tuple(
            replace(part, **{name: new_id(target, getattr(part, name)) for name, target in self.links(part)})
            for part in self.parts_of(record)
        )
        return replace(record, **{record.__struct_fields__[-1]: parts})

    def size(self, record: T) -> int:
        """Return the bytes of `record` on the wire, and by assumption on the board."""
        return layout(self.add_class, "little").size(len(self.parts_of(record)))

    def list_size(self, count: int) -> int:
        """Return the bytes of a list response with `count` entries."""
        return layout(self._list_response, "little").size(count)

    @property
    def list_limit(self) -> int:
        """Number of entries that fit into a list response."""
        return layout(self._list_response, "little").rule.limit

    @property
    def _list_response(self) -> type[Packet]:
        return PACKETS.response_of(self.list_request)


def _step_links(step: object) -> Iterable[tuple[str, RecordType[Any]]]:
    return ()


def _command_links(command: MacroCommand) -> Iterable[tuple[str, RecordType[Any]]]:
    match command.type:
        case MacroCommandType.ACTION:
            return (("command_id", ACTION),)
        case MacroCommandType.MACRO:
            return (("command_id", MACRO),)
        case _:  # a delay, or a type unknown to the document
            return ()


def _button_links(button: Button) -> Iterable[tuple[str, RecordType[Any]]]:
    return ("button_press_macro", MACRO), ("button_long_press_macro", MACRO), ("button_up_macro", MACRO)


ACTION = RecordType(
    "action",
    "actions",
    Action,
    editing.AddActionRequest,
    editing.QueryActionListRequest(),
    editing.QueryActionRequest,
    editing.DeleteActionRequest,
    _step_links,
)
MACRO = RecordType(
    "macro",
    "macros",
    Macro,
    editing.AddMacroRequest,
    editing.QueryMacroListRequest(),
    editing.QueryMacroRequest,
    editing.DeleteMacroRequest,
    _command_links,
)
TABLE = RecordType(
    "joystick table",
    "joystick_tables",
    JoystickTable,
    joystick.AddJoystickTableRequest,
    joystick.QueryJoystickTableListRequest(),
    joystick.QueryJoystickTableRequest,
    joystick.DeleteJoystickTableRequest,
    _button_links,
)
SERVO_PARAMETER = StoredType("servo parameter", "servo_parameters", ServoParameter, editing.AddServoParameterRequest)

RECORD_TYPES: tuple[RecordType[Any], ...] = (ACTION, MACRO, TABLE)
"""Record types in the order of writing: a record is stored after all records it refers to."""
STORED_TYPES: tuple[StoredType[Any], ...] = (SERVO_PARAMETER, *RECORD_TYPES)
"""All types, in the order of a project file."""
