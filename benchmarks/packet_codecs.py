"""The 60 packets as other tools declare them: dataclasses with `struct`, and construct.

Both are made from the same declarations, in big-endian byte order.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, make_dataclass
from importlib import import_module
from operator import attrgetter
from struct import Struct
from typing import Any, ClassVar, get_type_hints

from servolink.protocol.caption import CAPTION_SIZE
from servolink.protocol.codec import PACKETS
from servolink.protocol.frame import encode_frame
from servolink.protocol.packet import Packet, Value, bare, counted, group, value

_Decode = Callable[[bytes], Any]
_Encode = Callable[[Any], bytes]


@dataclass(frozen=True)
class Shape:
    """What a packet is made of."""

    name: str
    fields: list[Value]
    tail: str = ""
    """The name of the group or of the rest of the bytes; empty if there is none."""
    count: str = ""
    """The `struct` code of the group's count; empty if the tail is bytes."""
    items: tuple[Value, ...] = ()
    """The fields of a record, or one without a name: bare numbers."""

    @classmethod
    def of(cls, declared: type[Packet]) -> Shape:
        """Return the shape of a packet."""
        hints = get_type_hints(declared, include_extras=True)
        *names, last = declared.__struct_fields__ or ("",)
        count = counted(hints.get(last))
        fields = [value(name, hints[name]) for name in names]
        if count is not None:
            return cls(declared.__name__, fields, last, count.count, tuple(group(hints[last])[1]))
        if bare(hints.get(last)) is bytes:
            return cls(declared.__name__, fields, last)
        return cls(declared.__name__, [*fields, value(last, hints[last])] if last else [])


class PacketCodec(ABC):
    """Contents to objects and objects to frames, by packet id."""

    name: ClassVar[str]
    package: ClassVar[str] = ""
    """What is installed to have it; empty if it comes with Python."""

    def __init__(self) -> None:
        """Make decoder and encoder of each packet."""
        self._decoders: dict[int, _Decode] = {}
        self._encoders: dict[int, _Encode] = {}
        for packet_id, declared in PACKETS.items():
            codec = self._codec(Shape.of(declared))
            if codec is not None:
                self._decoders[packet_id], self._encoders[packet_id] = codec

    def knows(self, packet_id: int) -> bool:
        """Tell whether this tool has anything to do for a packet."""
        return packet_id in self._decoders

    def decode(self, packet_id: int, content: bytes) -> Any:
        """Return the object in `content`."""
        return self._decoders[packet_id](content)

    def encode(self, packet_id: int, packet: Any) -> bytes:
        """Return the frame of an object."""
        return encode_frame(packet_id, self._encoders[packet_id](packet), "big")

    @abstractmethod
    def _codec(self, shape: Shape) -> tuple[_Decode, _Encode] | None:
        """Return what decodes and what encodes a content; None if the tool has nothing to do for it."""


def _text(raw: bytes) -> str:
    return raw.partition(b"\0")[0].decode()


class Dataclasses(PacketCodec):
    """Frozen dataclasses with slots, and `struct` formats that are compiled once, as a textbook has it."""

    name = "dataclass"

    def _codec(self, shape: Shape) -> tuple[_Decode, _Encode]:
        optional = shape.fields[-1:] if shape.fields and shape.fields[-1].optional else []
        fixed = shape.fields[: len(shape.fields) - len(optional)]
        packet = _dataclass(shape.name, [*(field.name for field in shape.fields), *filter(None, [shape.tail])])
        read_head, write_head, head = _row(fixed, shape.count)
        if shape.count:
            return self._group(shape, packet, head)
        if shape.tail:
            return packet, attrgetter(shape.tail)
        if not optional:
            return lambda content: packet(*read_head(content, 0)), write_head
        read_all, write_all, whole = _row(shape.fields)

        def decode(content: bytes) -> Any:
            if len(content) == whole.size:
                return packet(*read_all(content, 0))
            return packet(*read_head(content, 0), None)

        def encode(packet: Any) -> bytes:
            return write_head(packet) if getattr(packet, optional[0].name) is None else write_all(packet)

        return decode, encode

    @staticmethod
    def _group(shape: Shape, packet: type[Any], head: Struct) -> tuple[_Decode, _Encode]:
        record = _dataclass("Record", [item.name for item in shape.items]) if shape.items[0].name else None
        read_item, write_item, item = _row(list(shape.items))
        read_fields, write_fields, _ = _row(shape.fields)
        count = Struct(">" + shape.count)
        counted_at, tail = head.size - count.size, attrgetter(shape.tail)

        def decode(content: bytes) -> Any:
            fields = read_fields(content, 0)
            (many,) = count.unpack_from(content, counted_at)
            if len(content) != head.size + many * item.size:
                raise ValueError("the count is wrong")
            records = []
            for at in range(head.size, len(content), item.size):
                row = read_item(content, at)
                records.append(row[0] if record is None else record(*row))
            return packet(*fields, tuple(records))

        def encode(packet: Any) -> bytes:
            records = tail(packet)
            parts = [item.pack(one) if record is None else write_item(one) for one in records]
            return write_fields(packet) + count.pack(len(records)) + b"".join(parts)

        return decode, encode


def _dataclass(name: str, fields: list[str]) -> type[Any]:
    return make_dataclass(name, fields, frozen=True, slots=True)


def _row(values: list[Value], count: str = "") -> tuple[Callable[[bytes, int], Any], _Encode, Struct]:
    """Return what reads the values at a place, what writes those of an object, and the format of both and a count."""
    codes = "".join(field.code for field in values)
    row, whole = Struct(">" + codes), Struct(">" + codes + count)
    captions = [at for at, field in enumerate(values) if field.is_caption]
    names = [field.name for field in values]

    def read(content: bytes, at: int) -> Any:
        numbers = row.unpack_from(content, at)
        if not captions:
            return numbers
        fields = [*numbers]
        for caption in captions:
            fields[caption] = _text(fields[caption])
        return fields

    def write(packet: Any) -> bytes:
        fields = [getattr(packet, name) for name in names]
        for caption in captions:
            fields[caption] = fields[caption].encode()
        return row.pack(*fields)

    return read, write, whole


class Construct(PacketCodec):
    """Its declarations, compiled, which is its fast half."""

    name = package = "construct"

    def _codec(self, shape: Shape) -> tuple[_Decode, _Encode]:
        construct = import_module("construct")
        kinds = {"B": "Int8ub", "H": "Int16ub", "I": "Int32ub", "h": "Int16sb", "i": "Int32sb"}

        def field(one: Value) -> Any:
            if one.is_caption:
                return construct.PaddedString(CAPTION_SIZE, "utf8")
            kind = getattr(construct, kinds[one.code])
            return construct.Optional(kind) if one.optional else kind

        members = [one.name / field(one) for one in shape.fields]
        if shape.count:
            item = construct.Struct(*[one.name / field(one) for one in shape.items if one.name])
            item = item if shape.items[0].name else field(shape.items[0])
            members.append(shape.tail / construct.PrefixedArray(getattr(construct, kinds[shape.count]), item))
        elif shape.tail:
            members.append(shape.tail / construct.GreedyBytes)
        compiled = construct.Struct(*members).compile()
        return compiled.parse, compiled.build


def plain(packet: Any) -> Any:
    """Return the values of any of these objects, as tuples."""
    if isinstance(packet, dict):
        return tuple(plain(field) for name, field in packet.items() if not name.startswith("_"))
    if isinstance(packet, (list, tuple)):
        return tuple(map(plain, packet))
    names = getattr(packet, "__struct_fields__", getattr(packet, "__dataclass_fields__", None))
    return packet if names is None else tuple(plain(getattr(packet, name)) for name in names)
