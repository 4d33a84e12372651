"""Packets and records as plain values for `json`, and back.

A packet keeps the raw fields, because the meaning of a field can depend on the board:
`{"packet": "QueryActionResponse", "id": 30021, "fields": {...}}`. Names are as in the document, in snake_case;
counts are left out, and `data` is in hex.

A record has the form of project files, with units in the names (`interval_ms`) and types of macro commands in words.
Files, `--json` and all other outputs share this form.
"""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache, reduce
from operator import or_
from types import GenericAlias
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import msgspec
from msgspec import NODEFAULT, Meta, Struct

from servolink.errors import EncodeError, quote
from servolink.protocol.caption import CAPTION_SIZE
from servolink.protocol.codec import PACKETS
from servolink.protocol.json_errors import convert
from servolink.protocol.packet import I32, FieldFormat, Natural32, Packet, wire_range
from servolink.protocol.records import MacroCommand, MacroCommandType

T = TypeVar("T", bound=Struct)
_COMPARED = 64  # characters of a name; typed text may be of any length


def packet_to_json(packet: Packet) -> dict[str, Any]:
    """Return the object for `packet`, ready for `json.dumps`."""
    fields = msgspec.to_builtins(packet, builtin_types=[bytes])
    if "data" in fields:
        fields["data"] = bytes(fields["data"]).hex()
    return {"packet": type(packet).__name__, "id": packet.packet_id, "fields": fields}


def packet_from_json(value: Any) -> Packet:
    """Return the packet described by `value`. Raise EncodeError naming packet, field, value and range.

    Either `packet` or `id` may be missing, and `fields` for a packet without fields.
    """
    declared = _declared(value)
    name = declared.__name__
    fields = value.get("fields", {})
    if not isinstance(fields, dict):
        raise EncodeError(f"must be an object, not {quote(fields)}", "fields", name)
    if unknown := sorted(str(field) for field in fields if field not in declared.__struct_fields__):
        names = ", ".join(declared.__struct_fields__) or "none"
        raise EncodeError(f"no such field; the fields are {names}", unknown[0], name)
    if declared.__struct_fields__ == ("data",) and "data" in fields:
        fields = {"data": _from_hex(fields["data"], name)}
    try:
        packet: Packet = convert(fields, declared)
    except EncodeError as error:
        raise EncodeError(error.text, error.path, name) from None
    return packet


def _declared(value: Any) -> type[Packet]:
    if not isinstance(value, dict):
        raise EncodeError(f"must be an object with packet and fields, not {quote(value)}")
    name, packet_id = value.get("packet"), value.get("id")
    if name is None and packet_id is None:
        raise EncodeError("the object has neither packet nor id")
    by_name = PACKETS.by_name.get(name) if isinstance(name, str) else None
    by_id = PACKETS.get(packet_id) if isinstance(packet_id, int) else None
    if name is not None and by_name is None:
        raise EncodeError(f"there is no {quote(name)}{_suggestion(name)}", "packet")
    if packet_id is not None and by_id is None:
        raise EncodeError(f"no packet has the id {quote(packet_id)}", "id")
    if by_name and by_id and by_name is not by_id:
        raise EncodeError(f"{by_name.__name__} has the id {by_name.packet_id}, not {packet_id}", "id")
    declared = by_name or by_id
    assert declared is not None  # noqa: S101 - one of both was given and found
    return declared


def _suggestion(name: Any) -> str:
    """Return a suggestion for the misspelt name of a packet, as the end of a sentence; empty without a similar name."""
    close = get_close_matches(name[:_COMPARED], PACKETS.by_name, n=1) if isinstance(name, str) else []
    return f"; did you mean {close[0]}?" if close else ""


def _from_hex(text: Any, name: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except (TypeError, ValueError):
        raise EncodeError(f"must be text of hex digits, not {quote(text)}", "data", name) from None


_UNITS = {"interval": ("interval_ms", 10), "ratio": ("ratio_percent", 1), "total_interval": ("total_interval_ms", 1)}
"""Name in JSON, and JSON units per unit of the board, by field of a record."""
_DESCRIPTIONS = {
    "action_id": None,
    "macro_id": None,
    "table_id": None,
    "interval_ms": "time, ms",
    "total_interval_ms": "duration of the command with its loops, ms; 0 if not given",
}
"""Descriptions for fields with other units or another meaning than in the packets."""
_COMMANDS = {
    MacroCommandType.ACTION: ("action", "action_id", "the action to run"),
    MacroCommandType.DELAY: ("delay", "delay_ms", "how long to wait, ms"),
    MacroCommandType.MACRO: ("macro", "macro_id", "the macro to run"),
}
"""JSON word, and name and description of the first field, by type of a macro command."""
_OTHER = ("other", "command_id", "what a board sent for a command of no known type")
_TYPES = {word: number for number, (word, _, _) in _COMMANDS.items()}
_NO_CONTROLS = r"^(?![\s\S]*[\u0000-\u001f\u007f-\u009f])"


def record_to_json(record: Any) -> Any:
    """Return the object for a record, a part of a record, or another struct of records, ready for `json.dumps`.

    Anything but a struct, never valid in a record, is returned unchanged: `record_from_json` names the fault.
    """
    if not isinstance(record, Struct):
        return record
    if isinstance(record, MacroCommand):
        return _command_to_json(record)
    return {field.key: _value_to_json(getattr(record, field.name), field) for field in _fields(type(record))}


def record_from_json(record_class: type[T], value: Any, *, unchecked: bool = False) -> T:
    """Return the record described by `value`, JSON or an instance of its `json_type`.

    Raise EncodeError naming path, value and range.
    `unchecked` accepts all values that a board can have sent: numbers in the range of the wire but outside the
    document's, captions with control characters, macro commands of other types.
    """
    if isinstance(value, Struct):
        return _from_given(record_class, value)
    return _from_given(record_class, convert(value, json_type(record_class, unchecked=unchecked)))


def _from_given(record_class: type[T], given: Any) -> T:
    """Return the `record_class` for `given`, an instance of its `json_type`."""
    if record_class is MacroCommand:
        return record_class(*_command_values(given))
    values = []
    for field in _fields(record_class):
        value: Any = getattr(given, field.key)
        if field.item is not None:
            value = tuple(_from_given(field.item, one) for one in value)
        values.append(value // field.unit if field.unit > 1 else value)
    return record_class(*values)


@cache
def json_type(record_class: type[Struct], *, unchecked: bool, head: tuple[tuple[str, Any, Any], ...] = ()) -> Any:
    """Return the msgspec type of a record's JSON; `head` lists fields in front of the record's."""
    if record_class is MacroCommand:
        return _command_types(unchecked=unchecked)
    fields = [(field.key, _field_type(field, unchecked=unchecked), field.default) for field in _fields(record_class)]
    return _struct(record_class.__name__, [*head, *fields], record_class.__doc__)


def _command_to_json(command: MacroCommand) -> dict[str, Any]:
    number: Any = command.type
    word, key, _ = _COMMANDS.get(number, _OTHER)
    start = {"type": word} if word in _TYPES else {"type": word, "type_number": number}
    rest = {field.key: _value_to_json(getattr(command, field.name), field) for field in _fields(MacroCommand)[2:]}
    return {**start, key: command.command_id, **rest}


def _command_values(given: Any) -> tuple[Any, ...]:
    word = given.__struct_config__.tag
    number: Any = given.type_number if word == _OTHER[0] else _TYPES[word].value
    key = _COMMANDS.get(number, _OTHER)[1]
    return getattr(given, key), number, given.ratio_percent, given.loop, given.total_interval_ms


def _value_to_json(value: Any, field: _JsonField) -> Any:
    if isinstance(value, (tuple, list)):
        return [record_to_json(one) for one in value]
    if isinstance(value, int):
        return int(value) * field.unit  # packets accept True as a number, JSON does not
    return value


@dataclass(frozen=True, slots=True)
class _JsonField:
    """Field of a record with the corresponding JSON field."""

    name: str
    key: str
    unit: int
    item: type[Struct] | None
    """Type of the records in a list."""
    hint: Any
    default: Any


@cache
def _fields(record_class: type[Struct]) -> tuple[_JsonField, ...]:
    hints = get_type_hints(record_class, include_extras=True)
    return tuple(
        _JsonField(
            info.name,
            *_UNITS.get(info.name, (info.name, 1)),
            _item(hints[info.name]),
            hints[info.name],
            info.default,
        )
        for info in msgspec.structs.fields(record_class)
    )


def _item(hint: Any) -> type[Struct] | None:
    """Return the type of the records in a list, None if `hint` is not a list."""
    bare = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    return get_args(bare)[0] if get_origin(bare) is tuple else None


def _field_type(field: _JsonField, *, unchecked: bool) -> Any:
    if field.item is not None:
        return GenericAlias(tuple, (json_type(field.item, unchecked=unchecked), ...))
    metadata = field.hint.__metadata__
    code = next((one.code for one in metadata if isinstance(one, FieldFormat)), "")
    if not code:
        return field.hint  # may be null; the range is that of the wire
    metas = [one for one in metadata if isinstance(one, Meta)]
    about = Meta(
        description=_DESCRIPTIONS.get(field.key, next((one.description for one in metas if one.description), None))
    )
    if code.endswith("s"):
        checked = () if unchecked else (Meta(max_length=CAPTION_SIZE, pattern=_NO_CONTROLS),)
        return _annotated(str, *checked, about)
    low, high = wire_range(code)
    if not unchecked:
        low = max([low, *(int(one.ge) for one in metas if one.ge is not None)])
        high = min([high, *(int(one.le) for one in metas if one.le is not None)])
    step = field.unit if field.unit > 1 else None
    return _annotated(int, Meta(ge=low * field.unit, le=high * field.unit, multiple_of=step), about)


def _annotated(kind: type, *metas: Meta) -> Any:
    return Annotated[kind, *metas]


def _command_types(*, unchecked: bool) -> Any:
    """Return the union of the types of macro commands, distinguished by `type`."""
    shared = [
        (field.key, _field_type(field, unchecked=unchecked), field.default) for field in _fields(MacroCommand)[2:]
    ]
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
        tag=tag,
        tag_field="type" if tag else None,
    )
