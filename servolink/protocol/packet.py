"""Base classes and field types for the declaration of packets."""

from __future__ import annotations

import sys
import types
from enum import Enum
from functools import cache
from operator import index
from struct import Struct as Format
from typing import Annotated, Any, ClassVar, Generic, Self, TypeVar, Union, get_args, get_origin

import msgspec
from msgspec import Meta, Struct
from msgspec import Struct as Record

from servolink.errors import escape, quote

_LONGEST = 120  # characters of a packet in an error


class FieldFormat(Struct, frozen=True):
    """Form of a value on the wire: a `struct` code without byte order."""

    code: str


class Counted(Struct, frozen=True):
    """Repeated group behind the fixed fields, preceded by a count with this `struct` code."""

    count: str


U8 = Annotated[int, Meta(ge=0, le=0xFF), FieldFormat("B")]
U32 = Annotated[int, Meta(ge=0, le=0xFFFF_FFFF), FieldFormat("I")]
I16 = Annotated[int, Meta(ge=-0x8000, le=0x7FFF), FieldFormat("h")]
I32 = Annotated[int, Meta(ge=-0x8000_0000, le=0x7FFF_FFFF), FieldFormat("i")]

# Same form on the wire, narrower range for values written by the library. Values from a board may exceed the range.
Flag = Annotated[int, Meta(ge=0, le=1), FieldFormat("B")]
CommandType = Annotated[int, Meta(ge=0, le=2), FieldFormat("B")]
Percent = Annotated[int, Meta(ge=1, le=100), FieldFormat("B")]
Natural16 = Annotated[int, Meta(ge=0, le=0x7FFF), FieldFormat("h")]
Natural32 = Annotated[int, Meta(ge=0, le=0x7FFF_FFFF), FieldFormat("i")]

Caption = Annotated[str, FieldFormat("32s")]
Data = bytes
"""All the remaining content; allowed only as the last field."""

U8_COUNT = Counted("B")
U16_COUNT = Counted("H")


class Value(Struct, frozen=True):
    """Number or caption of a packet or a record."""

    name: str
    code: str
    low: int
    high: int
    optional: bool = False

    @property
    def is_caption(self) -> bool:
        """Whether the value is text."""
        return self.code == "32s"

    @property
    def narrow(self) -> bool:
        """Whether the value is a number with a range narrower than on the wire."""
        return not self.is_caption and (self.low, self.high) != wire_range(self.code)

    def fault(self, value: object) -> str:
        """Return the fault of `value`, as the end of a sentence after the field name; empty for a suitable value."""
        try:
            fits = self.low <= index(value) <= self.high  # type: ignore[arg-type]  # raises for these
        except TypeError:
            return f"must be an integer, not {quote(value)}"
        return "" if fits else f"{quote(value)} is outside {self.low}..{self.high}"


def field_hints(declared: type[Struct]) -> dict[str, Any]:
    """Return the annotation of each field of a packet or a record, in the order of the fields.

    `typing.get_type_hints` would evaluate the class variables of all base classes as well, and takes six times as long.
    """
    texts = {
        name: (text, base.__module__)
        for base in reversed(declared.__mro__)
        for name, text in vars(base).get("__annotations__", {}).items()
    }
    return {name: _evaluated(*texts[name]) for name in declared.__struct_fields__}


@cache
def _evaluated(text: str, module: str) -> Any:
    return eval(text, vars(sys.modules[module]))  # noqa: S307 - an annotation in a module of servolink


def value(name: str, hint: Any) -> Value:
    """Return the value declared by a field. Raise TypeError for an annotation without a wire form."""
    optional = types.NoneType in _choices(hint)
    wire = metadata(hint, FieldFormat)
    if wire is None:
        raise TypeError(f"{name}: {hint} has no wire form")
    low, high = wire_range(wire.code)
    for meta in _all_metadata(hint):
        if isinstance(meta, Meta):
            low = low if meta.ge is None else int(meta.ge)
            high = high if meta.le is None else int(meta.le)
    return Value(name, wire.code, low, high, optional)


def group(hint: Any) -> tuple[type[Record] | None, list[Value]]:
    """Return record class (None for plain numbers) and values of a group declared as `tuple[item, ...]`."""
    item = get_args(bare(hint))[0]
    if isinstance(item, type) and issubclass(item, Record):
        return item, [value(name, hint) for name, hint in field_hints(item).items()]
    return None, [value("", item)]


def counted(hint: Any) -> Counted | None:
    """Return the form of the count of the group declared by `hint`; None without a group."""
    found: Counted | None = metadata(hint, Counted)
    return found


def wire_range(code: str) -> tuple[int, int]:
    """Return the lowest and the highest number of a `struct` code; 0 and 0 for text."""
    if code.endswith("s"):
        return 0, 0
    bits = 8 * Format("<" + code).size
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if code.islower() else (0, (1 << bits) - 1)


def bare(hint: Any) -> Any:
    """Return `hint` without the annotations around the type."""
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def description(hint: Any) -> str:
    """Return the description of a field; empty if missing."""
    metas = (each for each in _all_metadata(hint) if isinstance(each, Meta))
    return next((each.description for each in metas if each.description), "")


def metadata(hint: Any, kind: type) -> Any:
    """Return the first metadata of type `kind`, None without any."""
    return next((entry for entry in _all_metadata(hint) if isinstance(entry, kind)), None)


def _choices(hint: Any) -> tuple[Any, ...]:
    """Return the members of a union, without annotations; for any other type, only the type itself."""
    found = bare(hint)
    return get_args(found) if get_origin(found) in (Union, types.UnionType) else (found,)


def _all_metadata(hint: Any) -> list[Any]:
    found = list(hint.__metadata__) if get_origin(hint) is Annotated else []
    if get_origin(bare(hint)) in (Union, types.UnionType):
        for member in _choices(hint):
            found += _all_metadata(member)
    return found


class Effect(Enum):
    """Effect of a packet on the servos of the robot."""

    MOVES = "moves"
    """Servos turn, or start to turn."""
    MAY_MOVE = "may move"
    """Servos may turn: at once, to a new correction, or later, by a button of an active joystick table."""
    GOES_LIMP = "goes limp"
    """Servos are released, and drop their loads."""
    STOPS = "stops"
    """Servos stop and hold, a request that any program may send at any time (3.2.3)."""
    NONE = "none"
    """No servo turns or gives way."""


class Packet(Struct, frozen=True, gc=False):
    """Base class of the document's 60 packets; the class fields have the same order as on the wire."""

    packet_id: ClassVar[int]
    section: ClassVar[str]
    """Section of the document with the definition of the packet."""
    is_query: ClassVar[bool] = False
    """Whether the packet is a `Query`, as `isinstance` finds out in five times the time."""
    repeatable: ClassVar[bool] = False
    """Whether the host may repeat the packet: sent twice, the effect is the same."""
    exclusive: ClassVar[bool] = False
    """Whether no other packet may be under way at the same time: the order decides the effect of both."""
    effect: ClassVar[Effect] = Effect.NONE
    """Effect on the servos; declared by each packet from the host, except queries."""

    @property
    def described(self) -> str:
        """Packet as short, safe text for an error."""
        text = escape(repr(self))
        return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."

    @property
    def short_name(self) -> str:
        """Name without `Request`, as in profiles: `QueryMemorySize`."""
        return type(self).__name__.removesuffix("Request")

    @property
    def is_motion(self) -> bool:
        """Whether the packet can make a servo turn or go limp as soon as it is sent.

        Repeatable packets turn nothing by themselves: an active joystick table waits for a button.
        """
        match self.effect:
            case Effect.MOVES | Effect.GOES_LIMP:
                return True
            case Effect.MAY_MOVE:
                return not self.repeatable
            case _:
                return False

    def is_in_range(self) -> bool:
        """Return whether all values are in the declared range, unchecked by decoding."""
        try:
            msgspec.convert(msgspec.to_builtins(self), type(self))
        except msgspec.ValidationError:
            return False
        return True


class Response(Packet, frozen=True, gc=False):
    """A packet sent by the board."""


class Result(Response, frozen=True, gc=False):
    """Response with nothing but the success of the request."""

    result: Annotated[U8, Meta(description="0 failed, 1 done")]


R_co = TypeVar("R_co", bound=Response, covariant=True)


class Command(Packet, frozen=True, gc=False):
    """A packet sent by the host, without a response."""


class Request(Packet, Generic[R_co], frozen=True, gc=False):
    """A packet sent by the host that may change the board, with the response `R_co` under the next higher id."""

    echoed: ClassVar[str] = ""
    """Field repeated in the response; after a refusal, the board sends 0 in the same place."""
    changes: ClassVar[str] = ""
    """Field with the id of the single record changed by the request; empty for any other change."""

    def __class_getitem__(cls, response: Any) -> type[Self]:
        """Return the class itself: only type checkers need the response, and making each alias takes time at import."""
        return cls

    def accepts(self, response: Response) -> bool:
        """Return whether `response`, with the right id, can be the response to exactly this request."""
        if not self.echoed:
            return True
        return getattr(response, self.echoed) in (getattr(self, self.echoed), 0)


class Query(Request[R_co], frozen=True, gc=False):
    """Request without any change to the board, safe to repeat."""

    is_query: ClassVar[bool] = True
    repeatable: ClassVar[bool] = True
