"""Packets as plain objects, the form that JSON, the shell and other programs see.

`{"packet": "QueryActionResponse", "id": 30021, "fields": {...}}`: names of the document in snake_case, raw
wire values, counts left out, `data` in hex.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, reduce
from operator import or_
from types import GenericAlias
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import msgspec
from msgspec import NODEFAULT, UNSET, Meta, Struct, UnsetType

from servolink.errors import EncodeError
from servolink.escaping import escape, quote
from servolink.project.model import Project
from servolink.protocol.caption import CAPTION_SIZE
from servolink.protocol.codec import PACKETS, PACKETS_BY_NAME
from servolink.protocol.layout import layout
from servolink.protocol.packet import I32, Natural32, Packet, Wire, wire_range
from servolink.protocol.records import MacroCommand


def to_object(packet: Packet) -> dict[str, Any]:
    """Return the object of `packet`, ready for `json.dumps`."""
    fields = msgspec.to_builtins(packet, builtin_types=[bytes])
    if "data" in fields:
        fields["data"] = bytes(fields["data"]).hex()
    return {"packet": type(packet).__name__, "id": packet.packet_id, "fields": fields}


def from_object(described: Any) -> Packet:
    """Return the packet of such an object; EncodeError names packet, field, value and range.

    `packet` or `id` may be left out, `fields` of a packet without fields too.
    """
    declared = _declared(described)
    fields = described.get("fields", {})
    if not isinstance(fields, dict):
        raise EncodeError(f"must be an object, not {quote(fields)}", "fields", declared.__name__)
    if unknown := sorted(str(name) for name in fields if name not in declared.__struct_fields__):
        known = ", ".join(declared.__struct_fields__) or "none"
        raise EncodeError(f"no such field; it has {known}", unknown[0], declared.__name__)
    if declared.__struct_fields__ == ("data",) and "data" in fields:
        fields = {"data": _from_hex(fields["data"], declared.__name__)}
    try:
        return msgspec.convert(fields, declared, builtin_types=[bytes])
    except msgspec.ValidationError as error:
        raise EncodeError(_explain(declared, fields, str(error))) from None
    except UnicodeEncodeError as error:
        raise EncodeError(f"{declared.__name__}: {quote(error.object)} names no field of a record") from None


def _declared(described: Any) -> type[Packet]:
    if not isinstance(described, dict):
        raise EncodeError(f"must be an object with packet and fields, not {quote(described)}")
    name, packet_id = described.get("packet"), described.get("id")
    if name is None and packet_id is None:
        raise EncodeError("the object names neither packet nor id")
    by_name = PACKETS_BY_NAME.get(name) if isinstance(name, str) else None
    by_id = PACKETS.get(packet_id) if isinstance(packet_id, int) else None
    if name is not None and by_name is None:
        raise EncodeError(f"packet: there is no {quote(name)}")
    if packet_id is not None and by_id is None:
        raise EncodeError(f"id: no packet has the id {quote(packet_id)}")
    if by_name and by_id and by_name is not by_id:
        raise EncodeError(f"id: {by_name.__name__} has the id {by_name.packet_id}, not {packet_id}")
    declared = by_name or by_id
    assert declared is not None  # noqa: S101 - one of both was given and found
    return declared


def _from_hex(text: Any, packet: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except (TypeError, ValueError):
        raise EncodeError(f"must be text of hex digits, not {quote(text)}", "data", packet) from None


def _explain(declared: type[Packet], fields: Any, message: str) -> str:
    """Turn "Expected `int` <= 255 - at `$.steps[1].servo_id`" into our form, with the value that was given."""
    problem, at, path = escape(message).rpartition(" - at `$")  # the last: a name in a message may hold one too
    if not at:
        return f"{declared.__name__}: {path}"
    path = path.rstrip("`")
    value, name = fields, ""
    for part in path.replace("[", ".").replace("]", "").strip(".").split("."):
        if isinstance(value, (list, tuple)):
            value = value[int(part)]
        else:
            value, name = value[part], part
    if isinstance(value, int) and (fault := layout(declared, "little").fault(name, value)):
        return f"{declared.__name__}{path}: {fault}"
    return f"{declared.__name__}{path}: {quote(value)}: {problem[:1].lower()}{problem[1:]}"


SCHEMA = 1
"""The version of the format; it grows when an older servolink could not read what a newer one writes."""

_UNITS = {"interval": ("interval_ms", 10), "ratio": ("ratio_percent", 1), "total_interval": ("total_interval_ms", 1)}
"""Names in the file, and how many of the file's units make one of the board's."""
_OWN_WORDS = {
    "action_id": None,
    "macro_id": None,
    "table_id": None,
    "interval_ms": "time, ms",
    "total_interval_ms": "time of the whole command with its loops, ms; 0 if not given",
}
"""Descriptions where those of the packets speak of answers or of other units."""
_COMMANDS = {
    0: ("action", "action_id", "the action to run"),
    1: ("delay", "delay_ms", "how long to wait, ms"),
    2: ("macro", "macro_id", "the macro to run"),
}
"""Type of a macro's command: the word for it, the name of its first field and what that is."""
_OTHER = ("other", "command_id", "what a board said of a command of no known type")
_TYPES = {word: number for number, (word, _, _) in _COMMANDS.items()}
_NO_CONTROLS = r"^(?![\s\S]*[\u0000-\u001f\u007f-\u009f])"


@dataclass(frozen=True, slots=True)
class _Field:
    """One field of a packet's type, and how the file has it."""

    name: str
    key: str
    unit: int
    item: type[Struct] | None
    """Of a list of records."""
    hint: Any
    default: Any


@cache
def file_type(record: type[Struct], *, unchecked: bool) -> Any:
    """Return the type in the file of `record`, which is Project or a part of one."""
    if record is MacroCommand:
        return _command_types(unchecked=unchecked)
    fields = [(field.key, _in_file(field, unchecked=unchecked), field.default) for field in _fields(record)]
    if record is Project:
        fields = [
            ("schema", Annotated[Literal[SCHEMA], Meta(description="version of the format")], NODEFAULT),
            ("editor_schema", Annotated[str | UnsetType, Meta(description="JSON Schema, for editors")], UNSET),
            *fields,
        ]
    return _struct(record.__name__, fields, record.__doc__)


def of_file(record: type[Struct], given: Any) -> Any:
    """Return the `record` that `given`, an instance of its type in the file, stands for."""
    if record is MacroCommand:
        word = given.__struct_config__.tag
        number = given.type_number if word == _OTHER[0] else _TYPES[word]
        first = getattr(given, _COMMANDS.get(number, _OTHER)[1])
        return MacroCommand(first, number, given.ratio_percent, given.loop, given.total_interval_ms)
    values = []
    for field in _fields(record):
        value: Any = getattr(given, field.key)
        if field.item is not None:
            value = tuple(of_file(field.item, one) for one in value)
        values.append(value // field.unit if field.unit > 1 else value)
    return record(*values)


def to_file(record: Any) -> Any:
    """Return the object in the file for `record`; what is no record, and belongs in no project, is left as it is."""
    if not isinstance(record, Struct):
        return record
    start: dict[str, Any] = {}
    skipped = 0
    if isinstance(record, Project):
        start = {"schema": SCHEMA}
    elif isinstance(record, MacroCommand):
        word, key, _ = _COMMANDS.get(record.type, _OTHER)
        start = {"type": word} if word in _TYPES else {"type": word, "type_number": record.type}
        start[key] = record.command_id
        skipped = 2
    return start | {field.key: _value(getattr(record, field.name), field) for field in _fields(type(record))[skipped:]}


def _value(value: Any, field: _Field) -> Any:
    if isinstance(value, (tuple, list)):
        return [to_file(one) for one in value]
    if isinstance(value, int):
        return int(value) * field.unit  # True is a number to the packets, and none to JSON
    return value


@cache
def _fields(record: type[Struct]) -> tuple[_Field, ...]:
    hints = get_type_hints(record, include_extras=True)
    return tuple(
        _Field(
            info.name,
            *_UNITS.get(info.name, (info.name, 1)),
            _item(hints[info.name]),
            hints[info.name],
            info.default,
        )
        for info in msgspec.structs.fields(record)
    )


def _item(hint: Any) -> type[Struct] | None:
    """Return the type of the records in a list, None if `hint` is none."""
    bare = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    return get_args(bare)[0] if get_origin(bare) is tuple else None


def _in_file(field: _Field, *, unchecked: bool) -> Any:
    """Return the type of one field."""
    if field.item is not None:
        return GenericAlias(tuple, (file_type(field.item, unchecked=unchecked), ...))
    metadata = field.hint.__metadata__
    code = next((one.code for one in metadata if isinstance(one, Wire)), "")
    if not code:
        return field.hint  # may be null; its range is that of the wire
    metas = [one for one in metadata if isinstance(one, Meta)]
    about = Meta(
        description=_OWN_WORDS.get(field.key, next((one.description for one in metas if one.description), None))
    )
    if code.endswith("s"):
        return (
            Annotated[str, about]
            if unchecked
            else Annotated[str, Meta(max_length=CAPTION_SIZE, pattern=_NO_CONTROLS), about]
        )
    low, high = wire_range(code)
    if not unchecked:
        low = max([low, *(int(one.ge) for one in metas if one.ge is not None)])
        high = min([high, *(int(one.le) for one in metas if one.le is not None)])
    step = field.unit if field.unit > 1 else None
    return Annotated[int, Meta(ge=low * field.unit, le=high * field.unit, multiple_of=step), about]


def _command_types(*, unchecked: bool) -> Any:
    """Return the union of the types of a macro's commands, which `type` tells apart."""
    shared = [(field.key, _in_file(field, unchecked=unchecked), field.default) for field in _fields(MacroCommand)[2:]]
    types = []
    for word, key, description in (*_COMMANDS.values(), _OTHER) if unchecked else _COMMANDS.values():
        number = Natural32 if key == "delay_ms" and not unchecked else I32
        own: list[tuple[str, Any, Any]] = [(key, Annotated[number, Meta(description=description)], NODEFAULT)]
        if word == _OTHER[0]:
            own.insert(0, ("type_number", Annotated[int, Meta(ge=len(_COMMANDS), le=0xFF)], NODEFAULT))
        types.append(_struct(word.title() + "Command", [*own, *shared], tag=word))
    return reduce(or_, types)


def _struct(name: str, fields: list[tuple[str, Any, Any]], doc: str | None = None, tag: str | None = None) -> Any:
    return msgspec.defstruct(
        name,
        fields,
        namespace={"__doc__": doc},
        module=__name__,
        frozen=True,
        gc=False,
        forbid_unknown_fields=True,
        rename={"editor_schema": "$schema"},
        tag=tag,
        tag_field="type" if tag else None,
    )
