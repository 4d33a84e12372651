"""Golden frames of the document, and strategies that draw any declared packet."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import msgspec
from hypothesis import strategies as st
from msgspec import inspect

from servolink.protocol.codec import PACKETS
from servolink.protocol.frame import MAGIC, ByteOrder
from servolink.protocol.packet import Packet, Response

DATA = Path(__file__).parent.parent / "data"
DOCUMENT: dict[str, Any] = json.loads((DATA.parent / "lab/odd/protocol.json").read_text("utf-8"))


def snake_case(name: str) -> str:
    """Return the document's `name` in the style of the packets: servoIDList becomes servo_id_list."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


@dataclass(frozen=True)
class Vector:
    """A golden frame and the values in it."""

    packet_id: int
    name: str
    byte_order: ByteOrder
    fields: dict[str, Any]
    frame: bytes


def _vectors() -> list[Vector]:
    return [
        Vector(v["id"], v["name"], v["byte_order"], _without_counts(v["id"], v["values"]), bytes.fromhex(v["frame"]))
        for v in json.loads((DATA / "vectors.json").read_text())
    ]


def _without_counts(packet_id: int, values: dict[str, Any]) -> dict[str, Any]:
    described = next(packet for packet in DOCUMENT["packets"] if packet["id"] == packet_id)
    counts = {field.get("repeat") for field in described["fields"]}
    return {snake_case(name): _snake_cased(value) for name, value in values.items() if name not in counts}


def _snake_cased(value: Any) -> Any:
    if isinstance(value, dict):
        return {snake_case(name): part for name, part in value.items()}
    return [_snake_cased(part) for part in value] if isinstance(value, list) else value


VECTORS = _vectors()
VECTORS_BY_NAME = {name: [vector for vector in VECTORS if vector.name == name] for name in (v.name for v in VECTORS)}
"""Golden frames of each packet, in both byte orders."""

plain_captions = (
    st.text(st.characters(exclude_categories=("Cc", "Cs")), max_size=32)
    .map(lambda text: text.encode()[:32].decode(errors="ignore"))
    .filter(lambda text: MAGIC not in text.encode())
)
_any_captions = st.binary(max_size=32).map(lambda raw: raw.partition(b"\0")[0].decode("utf-8", "surrogateescape"))


def values_of(kind: inspect.Type, captions: st.SearchStrategy[str]) -> st.SearchStrategy[Any]:
    """Draw values of a field in the range of its `msgspec.Meta`."""
    match kind:
        case inspect.Metadata():
            return values_of(kind.type, captions)
        case inspect.IntType():
            low, high = cast("int", kind.ge), cast("int", kind.le)
            return st.sampled_from((low, high, min(high, low + 1))) | st.integers(low, high)
        case inspect.StrType():
            return captions
        case inspect.BytesType():
            return st.binary(max_size=300)
        case inspect.VarTupleType():
            return st.lists(values_of(kind.item_type, captions), max_size=6).map(tuple)
        case inspect.UnionType():
            return st.one_of([values_of(member, captions) for member in kind.types])
        case inspect.NoneType():
            return st.none()
        case inspect.StructType():
            return st.builds(kind.cls, **{field.name: values_of(field.type, captions) for field in kind.fields})
        case _:
            raise TypeError(f"no strategy for {kind}")


def packets_of(declared: type[Packet]) -> st.SearchStrategy[Packet]:
    """Draw packets of one class with any values that the declaration allows."""
    captions = _any_captions if issubclass(declared, Response) else plain_captions
    return cast("st.SearchStrategy[Packet]", values_of(inspect.type_info(declared), captions))


any_packet = st.sampled_from(sorted(PACKETS)).flatmap(lambda packet_id: packets_of(PACKETS[packet_id]))


def packet_of(vector: Vector) -> Packet:
    """Return the packet of a golden frame."""
    fields = dict(vector.fields)
    if "data" in fields:
        fields["data"] = bytes.fromhex(fields["data"])
    return msgspec.convert(fields, PACKETS[vector.packet_id], builtin_types=[bytes])
