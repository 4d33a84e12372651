"""Field types: each says what Python holds, what the wire carries and which values are allowed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta


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
