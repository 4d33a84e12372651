"""The base classes and field types with which packets are declared."""

from __future__ import annotations

import types
from enum import Enum
from operator import index
from struct import Struct as Format
from typing import Annotated, Any, ClassVar, Generic, TypeVar, Union, get_args, get_origin, get_type_hints

from msgspec import Meta, Struct
from msgspec import Struct as Record

from servolink.escaping import quote


class Wire(Struct, frozen=True):
    """The form of a value on the wire: a `struct` code without byte order."""

    code: str


class Counted(Struct, frozen=True):
    """A repeated group behind the fixed fields; its count, in this `struct` code, comes first."""

    count: str


U8 = Annotated[int, Meta(ge=0, le=0xFF), Wire("B")]
U32 = Annotated[int, Meta(ge=0, le=0xFFFF_FFFF), Wire("I")]
I16 = Annotated[int, Meta(ge=-0x8000, le=0x7FFF), Wire("h")]
I32 = Annotated[int, Meta(ge=-0x8000_0000, le=0x7FFF_FFFF), Wire("i")]

# The same on the wire, with a narrower range for values we write. Values from a board may be outside of it.
Flag = Annotated[int, Meta(ge=0, le=1), Wire("B")]
CommandType = Annotated[int, Meta(ge=0, le=2), Wire("B")]
Percent = Annotated[int, Meta(ge=1, le=100), Wire("B")]
Natural16 = Annotated[int, Meta(ge=0, le=0x7FFF), Wire("h")]
Natural32 = Annotated[int, Meta(ge=0, le=0x7FFF_FFFF), Wire("i")]

Caption = Annotated[str, Wire("32s")]
Data = bytes
"""All the remaining content; allowed only as the last field."""

U8_COUNT = Counted("B")
U16_COUNT = Counted("H")


class Value(Struct, frozen=True):
    """One number or caption of a packet or a record."""

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
        """Whether the value is a number whose range is narrower than that of the wire."""
        return not self.is_caption and (self.low, self.high) != wire_range(self.code)

    def fault(self, value: object) -> str:
        """Return why `value` does not fit, in words that follow the name of the field; empty if it fits."""
        try:
            fits = self.low <= index(value) <= self.high  # type: ignore[arg-type]  # raises for these
        except TypeError:
            return f"must be an integer, not {quote(value)}"
        return "" if fits else f"{quote(value)} is outside {self.low}..{self.high}"


def value(name: str, hint: Any) -> Value:
    """Return the value that a field declares. Raise TypeError if its annotation has no wire form."""
    optional = types.NoneType in _choices(hint)
    wire = metadata(hint, Wire)
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
        hints = get_type_hints(item, include_extras=True)
        return item, [value(name, hints[name]) for name in item.__struct_fields__]
    return None, [value("", item)]


def counted(hint: Any) -> Counted | None:
    """Return how the group is counted that `hint` declares; None if it declares none."""
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
    """Return the first metadata of this type; None without any."""
    return next((entry for entry in _all_metadata(hint) if isinstance(entry, kind)), None)


def _choices(hint: Any) -> tuple[Any, ...]:
    """Return the members of a union, ignoring annotations; of any other type that type itself."""
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
    """Servos turn, or start to."""
    MAY_MOVE = "may move"
    """Servos may turn: at once, to a new correction, or later, by a button of an active joystick table."""
    GOES_LIMP = "goes limp"
    """Servos are released, and drop what they hold."""
    STOPS = "stops"
    """Servos stop and hold, which anybody may ask for at any time (3.2.3)."""
    NONE = "none"
    """No servo turns or gives way."""


class Packet(Struct, frozen=True, gc=False):
    """One of the document's 60 packets; the fields of the class stand in their order on the wire."""

    packet_id: ClassVar[int]
    section: ClassVar[str]
    """The section of the document that defines the packet."""
    repeatable: ClassVar[bool] = False
    """Whether the host may send it again: doing it twice has the effect of doing it once."""
    alone: ClassVar[bool] = False
    """Whether no other packet may be under way beside it: their order decides what they do."""
    effect: ClassVar[Effect] = Effect.NONE
    """Effect on the servos; declared by each packet that the host sends, except queries."""


class Response(Packet, frozen=True, gc=False):
    """A packet sent by the board."""


class Result(Response, frozen=True, gc=False):
    """A response that only says whether the request was carried out."""

    result: Annotated[U8, Meta(description="0 failed, 1 done")]


R_co = TypeVar("R_co", bound=Response, covariant=True)


class Command(Packet, frozen=True, gc=False):
    """A packet sent by the host that has no response."""


class Request(Packet, Generic[R_co], frozen=True, gc=False):
    """A packet sent by the host with the response `R_co`, whose id is one higher. It may change the board."""

    echoed: ClassVar[str] = ""
    """The field that the response repeats; a board that refuses sends 0 in its place."""
    changes: ClassVar[str] = ""
    """The field with the id of the one record that the request changes, none if it changes anything else."""

    def accepts(self, response: Response) -> bool:
        """Return whether `response`, which has the right id, can be the response to exactly this request."""
        if not self.echoed:
            return True
        return getattr(response, self.echoed) in (getattr(self, self.echoed), 0)


class Query(Request[R_co], frozen=True, gc=False):
    """Request that changes nothing and may be repeated."""

    repeatable: ClassVar[bool] = True


def is_motion(packet: Packet) -> bool:
    """Return whether `packet` can make a servo turn, or drop what it holds, as soon as it is sent.

    What is repeatable turns nothing by itself: an active joystick table waits for a button.
    """
    match packet.effect:
        case Effect.MOVES | Effect.GOES_LIMP:
            return True
        case Effect.MAY_MOVE:
            return not packet.repeatable
        case _:
            return False
