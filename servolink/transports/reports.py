"""HID reports: what a report descriptor declares (HID 1.11, 6.2.2), and frames cut into reports."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import IntEnum

VENDOR_PAGES = range(0xFF00, 0x10000)
"""The usage pages that a maker may use for anything."""


class Way(IntEnum):
    """Which way a report goes; the number is its item's prefix in a descriptor, without the length."""

    IN = 0x80
    OUT = 0x90


@dataclass(frozen=True, slots=True)
class Report:
    """A report as declared: its size is in bytes, without the id that precedes it unless the id is 0."""

    way: Way
    report_id: int
    usage_page: int
    size: int


@dataclass(frozen=True, slots=True)
class _Globals:
    """The items that hold until they are given again."""

    usage_page: int = 0
    report_id: int = 0
    field_bits: int = 0
    fields: int = 0


def declared(descriptor: bytes) -> list[Report]:
    """Return the reports of a descriptor, in its order; what is cut off or makes no sense adds nothing."""
    bits: dict[tuple[Way, int, int], int] = {}
    state, stack = _Globals(), list[_Globals]()
    depth, page = 0, 0
    for prefix, value in _items(descriptor):
        if prefix == 0xA0:
            page = page if depth else state.usage_page  # a report belongs to the outermost collection's page
            depth += 1
        elif prefix == 0xC0:
            depth -= 1
        elif prefix in {Way.IN, Way.OUT}:
            key = Way(prefix), state.report_id, page
            bits[key] = bits.get(key, 0) + state.field_bits * state.fields
        elif prefix == 0xA4:
            stack.append(state)
        elif prefix == 0xB4 and stack:
            state = stack.pop()
        else:
            state = _changed(state, prefix, value)
    return [Report(way, report_id, page, (count + 7) // 8) for (way, report_id, page), count in bits.items() if count]


def _changed(state: _Globals, prefix: int, value: int) -> _Globals:
    match prefix:
        case 0x04:
            return replace(state, usage_page=value)
        case 0x74:
            return replace(state, field_bits=value)
        case 0x84:
            return replace(state, report_id=value)
        case 0x94:
            return replace(state, fields=value)
        case _:
            return state


def _items(descriptor: bytes) -> Iterator[tuple[int, int]]:
    """Yield type and tag of each item, as its prefix without the length, and its value."""
    position = 0
    while position < len(descriptor):
        prefix = descriptor[position]
        if prefix == 0xFE:  # a long item, which means nothing yet: its length follows
            position += 3 + (descriptor[position + 1] if position + 1 < len(descriptor) else 0)
            continue
        end = position + 1 + (0, 1, 2, 4)[prefix & 3]
        yield prefix & 0xFC, int.from_bytes(descriptor[position + 1 : end], "little")
        position = end


def cut(frame: bytes, report_id: int, size: int) -> Iterator[bytes]:
    """Yield the reports that carry `frame`: each with its id in front, also when that is 0, and filled with zeros."""
    for start in range(0, len(frame), size):
        yield bytes([report_id]) + frame[start : start + size].ljust(size, b"\0")
