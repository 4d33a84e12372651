"""Packets as plain objects, the form that JSON, the shell and other programs see.

`{"packet": "QueryActionResponse", "id": 30021, "fields": {...}}`: names of the document in snake_case, raw
wire values, counts left out, `data` in hex.
"""

from __future__ import annotations

from typing import Any

import msgspec

from servolink.errors import EncodeError
from servolink.printable import printable, shown
from servolink.protocol.layout import layout
from servolink.protocol.packet import Packet
from servolink.protocol.registry import PACKETS, PACKETS_BY_NAME


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
        raise EncodeError(f"{declared.__name__}.fields: {shown(fields)} is no object")
    if unknown := sorted(str(name) for name in fields if name not in declared.__struct_fields__):
        known = ", ".join(declared.__struct_fields__) or "none"
        raise EncodeError(f"{declared.__name__}.{printable(unknown[0])}: no such field; it has {known}")
    if declared.__struct_fields__ == ("data",) and "data" in fields:
        fields = {"data": _from_hex(fields["data"], f"{declared.__name__}.data")}
    try:
        return msgspec.convert(fields, declared, builtin_types=[bytes])
    except msgspec.ValidationError as error:
        raise EncodeError(_explain(declared, fields, str(error))) from None
    except UnicodeEncodeError as error:
        raise EncodeError(f"{declared.__name__}: {shown(error.object)} names no field of a record") from None


def _declared(described: Any) -> type[Packet]:
    if not isinstance(described, dict):
        raise EncodeError(f"{shown(described)} is no object with packet and fields")
    name, packet_id = described.get("packet"), described.get("id")
    if name is None and packet_id is None:
        raise EncodeError("the object names neither packet nor id")
    by_name = PACKETS_BY_NAME.get(name) if isinstance(name, str) else None
    by_id = PACKETS.get(packet_id) if isinstance(packet_id, int) else None
    if name is not None and by_name is None:
        raise EncodeError(f"packet: there is no {shown(name)}")
    if packet_id is not None and by_id is None:
        raise EncodeError(f"id: no packet has the id {shown(packet_id)}")
    if by_name and by_id and by_name is not by_id:
        raise EncodeError(f"id: {by_name.__name__} has the id {by_name.packet_id}, not {packet_id}")
    declared = by_name or by_id
    assert declared is not None  # noqa: S101 - one of both was given and found
    return declared


def _from_hex(text: Any, where: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except (TypeError, ValueError):
        raise EncodeError(f"{where}: {shown(text)} is no text of hex digits") from None


def _explain(declared: type[Packet], fields: Any, message: str) -> str:
    """Turn "Expected `int` <= 255 - at `$.steps[1].servo_id`" into our form, with the value that was given."""
    problem, at, path = printable(message).rpartition(" - at `$")  # the last: a name in a message may hold one too
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
    return f"{declared.__name__}{path}: {shown(value)}: {problem[:1].lower()}{problem[1:]}"
