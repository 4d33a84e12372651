"""What a packet is: the bases of all declarations."""

from __future__ import annotations

import types
from dataclasses import dataclass
from operator import index
from struct import Struct as Format
from typing import Annotated, Any, ClassVar, Generic, TypeVar, Union, get_args, get_origin, get_type_hints

from msgspec import Meta, Struct
from msgspec import Struct as Record

from servolink.escaping import quote


@dataclass(frozen=True, slots=True)
class Wire:
    """How one value lies on the wire: a `struct` code without byte order."""

    code: str


@dataclass(frozen=True, slots=True)
class Counted:
    """A repeated group, preceded (after the fixed fields) by its count in this `struct` code."""

    count: str


U8 = Annotated[int, Meta(ge=0, le=0xFF), Wire("B")]
U32 = Annotated[int, Meta(ge=0, le=0xFFFF_FFFF), Wire("I")]
I16 = Annotated[int, Meta(ge=-0x8000, le=0x7FFF), Wire("h")]
I32 = Annotated[int, Meta(ge=-0x8000_0000, le=0x7FFF_FFFF), Wire("i")]

# The same on the wire, with fewer values allowed when written. What a board sends is shown as it is.
Flag = Annotated[int, Meta(ge=0, le=1), Wire("B")]
CommandType = Annotated[int, Meta(ge=0, le=2), Wire("B")]
Percent = Annotated[int, Meta(ge=1, le=100), Wire("B")]
Natural16 = Annotated[int, Meta(ge=0, le=0x7FFF), Wire("h")]
Natural32 = Annotated[int, Meta(ge=0, le=0x7FFF_FFFF), Wire("i")]

Caption = Annotated[str, Wire("32s")]
Data = bytes
"""All remaining content; only as the last field."""

U8_COUNT = Counted("B")
U16_COUNT = Counted("H")


@dataclass(frozen=True, slots=True)
class Value:
    """One number or caption."""

    name: str
    code: str
    low: int
    high: int
    optional: bool = False

    @property
    def is_caption(self) -> bool:
        """Whether it is text, not a number."""
        return self.code == "32s"

    @property
    def narrow(self) -> bool:
        """Whether it is a number that may have fewer values than fit the wire."""
        return not self.is_caption and (self.low, self.high) != wire_range(self.code)

    def fault(self, value: object) -> str:
        """Say what is wrong with `value`, in words that follow the field's name; empty if nothing is."""
        try:
            fits = self.low <= index(value) <= self.high  # type: ignore[arg-type]
        except TypeError:
            return f"must be an integer, not {quote(value)}"
        return "" if fits else f"{quote(value)} is outside {self.low}..{self.high}"


def value(name: str, hint: Any) -> Value:
    """Return the value that a field of this name and annotation is; TypeError if it has no place on the wire."""
    optional = types.NoneType in _choices(hint)
    wire = metadata(hint, Wire)
    if wire is None:
        raise TypeError(f"{name}: {hint} says nothing of the wire")
    low, high = wire_range(wire.code)
    for meta in _all_metadata(hint):
        if isinstance(meta, Meta):
            low = low if meta.ge is None else int(meta.ge)
            high = high if meta.le is None else int(meta.le)
    return Value(name, wire.code, low, high, optional)


def group(hint: Any) -> tuple[type[Record] | None, list[Value]]:
    """Return record class (None for bare numbers) and values of a group declared as `tuple[item, ...]`."""
    item = get_args(bare(hint))[0]
    if isinstance(item, type) and issubclass(item, Record):
        hints = get_type_hints(item, include_extras=True)
        return item, [value(name, hints[name]) for name in item.__struct_fields__]
    return None, [value("", item)]


def counted(hint: Any) -> Counted | None:
    """Return how a group is counted; None if `hint` declares no group."""
    found: Counted | None = metadata(hint, Counted)
    return found


def wire_range(code: str) -> tuple[int, int]:
    """Return the lowest and the highest number of a `struct` code; 0 and 0 for text."""
    if code.endswith("s"):
        return 0, 0
    bits = 8 * Format("<" + code).size
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if code.islower() else (0, (1 << bits) - 1)


def bare(hint: Any) -> Any:
    """Return `hint` without its annotations."""
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def metadata(hint: Any, kind: type) -> Any:
    """Return the annotation of this kind, None if there is none."""
    return next((entry for entry in _all_metadata(hint) if isinstance(entry, kind)), None)


def _choices(hint: Any) -> tuple[Any, ...]:
    """Return the members of a union, looking through annotations; the hint itself if it is none."""
    found = bare(hint)
    return get_args(found) if get_origin(found) in (Union, types.UnionType) else (found,)


def _all_metadata(hint: Any) -> list[Any]:
    found = list(hint.__metadata__) if get_origin(hint) is Annotated else []
    if get_origin(bare(hint)) in (Union, types.UnionType):
        for member in _choices(hint):
            found += _all_metadata(member)
    return found


class Packet(Struct, frozen=True, gc=False):
    """One of the document's 60 packets; its fields, in their order on the wire, are the class's fields."""

    packet_id: ClassVar[int]
    section: ClassVar[str]
    """Where the document defines it."""


class Response(Packet, frozen=True, gc=False):
    """Sent by the board."""


class Result(Response, frozen=True, gc=False):
    """An answer that says only whether it was done."""

    result: Annotated[U8, Meta(description="0 failed, 1 done")]


R_co = TypeVar("R_co", bound=Response, covariant=True)


class Command(Packet, frozen=True, gc=False):
    """Sent by the host and never answered."""


class Request(Packet, Generic[R_co], frozen=True, gc=False):
    """Sent by the host and answered by `R_co`, whose id is one higher; it may change something on the board."""

    echoed: ClassVar[str] = ""
    """The field that the answer repeats; 0 in its place is the board's way to say no."""

    def accepts(self, response: Response) -> bool:
        """Tell whether `response`, of the right id, can be the answer to this very request."""
        if not self.echoed:
            return True
        return getattr(response, self.echoed) in (getattr(self, self.echoed), 0)


class Query(Request[R_co], frozen=True, gc=False):
    """A request that changes nothing and may be repeated."""
