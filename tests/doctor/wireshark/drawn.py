"""Random packets of any class, by seed, and what tshark must say of their fields."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random
from typing import Any, cast

from msgspec import Struct, inspect

from servolink.protocol import Codec, Packet

ALPHABETS = {
    "utf-8": "aZ9 ~%\"'<&>\\é中文字機器人🤖",
    "big5": "aZ9 ~%\"'<&>\\中文字機器人舵許功蓋",
    "gb18030": "aZ9 ~é中文字机器人",
    "utf-16-le": "aZ9 ~é中文字機器人",
    "utf-16-be": "aZ9 ~é中文字機器人",
    "latin-1": "aZ9 ~éüßÿ¿",
}
"""Characters of captions, by encoding."""


def drawn(declared: type[Packet], random: Random, encoding: str = "utf-8") -> Packet:
    """Return a packet with random values that the declaration allows."""
    return cast("Packet", _value(inspect.type_info(declared), random, encoding))


def _value(kind: inspect.Type, random: Random, encoding: str) -> Any:
    match kind:
        case inspect.Metadata():
            return _value(kind.type, random, encoding)
        case inspect.IntType():
            low, high = cast("int", kind.ge), cast("int", kind.le)
            return random.choice((low, high, random.randint(low, high)))
        case inspect.StrType():
            return _caption(random, encoding)
        case inspect.BytesType():
            return random.randbytes(random.choice((0, 1, 40)))
        case inspect.VarTupleType():
            return tuple(_value(kind.item_type, random, encoding) for _ in range(random.choice((0, 1, 2, 3, 19))))
        case inspect.UnionType():
            return _value(random.choice(kind.types), random, encoding)
        case inspect.NoneType():
            return None
        case inspect.StructType():
            return kind.cls(**{field.name: _value(field.type, random, encoding) for field in kind.fields})
        case _:
            raise TypeError(f"no values for {kind}")


def _caption(random: Random, encoding: str) -> str:
    text = "".join(random.choices(ALPHABETS[encoding], k=random.randint(0, 32)))
    while len(text.encode(encoding)) > 32:
        text = text[:-1]
    return text


def shown(packet: Packet, codec: Codec) -> list[tuple[str, str]]:
    """Return filter name and value of each field of a packet, in the order in which tshark must show them."""
    return list(_shown(codec.decode_frame(codec.encode(packet))))


def _shown(record: Struct) -> Iterator[tuple[str, str]]:
    for name in record.__struct_fields__:
        value = getattr(record, name)
        if isinstance(value, bytes):
            if value:
                yield name, value.hex(":")
        elif isinstance(value, tuple):
            yield f"{name}.count", str(len(value))
            for item in value:
                if isinstance(item, Struct):
                    yield name, ""
                    yield from _shown(item)
                else:
                    yield name, str(item)
        elif value is not None:
            yield name, str(value)
