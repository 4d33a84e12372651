"""The captions in a packet as bytes, for a board whose encoding is not known."""

from __future__ import annotations

from functools import cache
from struct import calcsize
from typing import NamedTuple, get_type_hints

from servolink.protocol.caption import CAPTION_SIZE
from servolink.protocol.packet import Packet, Value, bare, counted, group, value


class _Places(NamedTuple):
    """Where captions begin in the content of a packet."""

    head: list[int]
    base: int
    """Where the first record of the group begins."""
    unit: int
    """Bytes of a record; 0 without a group."""
    record: list[int]
    """In each record."""


def captions_in(declared: type[Packet], content: bytes) -> list[bytes]:
    """Return the 32 bytes of each caption in `content`, whatever its byte order."""
    head, base, unit, record = _places(declared)
    starts = list(head)
    if record:
        starts += [at + place for at in range(base, len(content) - unit + 1, unit) for place in record]
    return [content[at : at + CAPTION_SIZE] for at in starts]


@cache
def _places(declared: type[Packet]) -> _Places:
    hints = get_type_hints(declared, include_extras=True)
    fixed, count, records = list[Value](), "", list[Value]()
    for name in declared.__struct_fields__:
        if (how := counted(hints[name])) is not None:
            count, records = how.count, group(hints[name])[1]
        elif bare(hints[name]) is not bytes:
            fixed.append(value(name, hints[name]))
    head, end = _captions(fixed)
    record, unit = _captions(records)
    return _Places(head, end + calcsize(f"<{count}"), unit, record)


def _captions(values: list[Value]) -> tuple[list[int], int]:
    """Return where captions begin among `values`, and where the values end."""
    found, at = list[int](), 0
    for each in values:
        if each.is_caption:
            found.append(at)
        at += calcsize(f"<{each.code}")
    return found, at
