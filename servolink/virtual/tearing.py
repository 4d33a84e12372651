"""What is left of a write to the flash when the power goes in the middle of it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest
from random import Random
from typing import TypeAlias

from servolink.protocol.frame import ByteOrder
from servolink.virtual.storage import Contents, Kind, Record

_Place: TypeAlias = tuple[Record | None, Record | None]
"""A record's place in the flash: what is there before a write, and behind it."""

_COUNT, _ENTRIES = 36, 38
"""Where the count of a record's entries begins, and where the entries do; servo parameters have none."""
_ENTRY = {Kind.ACTION: 5, Kind.MACRO: 12, Kind.TABLE: 49}
_ERASED = b"\xff"


def tear(before: Contents, after: Contents, random: Random, byte_order: ByteOrder) -> Contents:
    """Return what may be left of the write that was to make `after` of `before`.

    A write changes records one by one, in any order, and the power goes at one of them or behind the last. Those in
    front of it are then as in `after`, those behind it as in `before`. That one is in any of the states that it goes
    through: the old record, the old one half erased, none, the new one half written. Project id and active table are
    words, which a flash writes at once: each is the old or the new one.
    """
    places = {kind: list(_places(before.records[kind], after.records[kind])) for kind in Kind}
    changes = [(kind, at) for kind in Kind for at, (old, new) in enumerate(places[kind]) if old is not new]
    random.shuffle(changes)
    for progress, (kind, at) in enumerate(changes, start=-random.randint(0, len(changes))):
        old, _ = places[kind][at]
        if progress == 0:
            places[kind][at] = (old, _half(kind, places[kind][at], random, byte_order))
        elif progress > 0:
            places[kind][at] = (old, old)
    return Contents(
        {kind: tuple([left for _, left in places[kind] if left is not None]) for kind in Kind},
        random.choice((before.project_id, after.project_id)),
        random.choice((before.chosen_table, after.chosen_table)),
    )


def _places(before: tuple[Record, ...], after: tuple[Record, ...]) -> Iterator[_Place]:
    """Yield each record before the write with what it becomes, and then those that are added."""
    if len(after) >= len(before):  # a record takes the place of the one that it replaces
        yield from zip_longest(before, after)
        return
    left = list(after)
    for record in before:
        yield (record, left.pop(0)) if left and left[0] is record else (record, None)


def _half(kind: Kind, place: _Place, random: Random, byte_order: ByteOrder) -> Record | None:
    """Return a state that a record goes through between before and after."""
    halves = [tear_record(kind, record, random, byte_order) for record in place if record is not None]
    return random.choice([*dict.fromkeys((place[0], None)), *halves])


def tear_record(kind: Kind, record: Record, random: Random, byte_order: ByteOrder) -> Record:
    """Return `record` without its tail: erased flash instead, or nothing. Its id and a true count of entries stay.

    The board knows a record's id and length from elsewhere, its directory, so that its answers remain frames.
    """
    record_id, content = record
    at = random.randrange(1 if kind is Kind.SERVO else 4, len(content))
    erased = random.random() < 0.5
    if kind is Kind.SERVO:
        return record_id, content[:at].ljust(len(content), _ERASED if erased else b"\0")
    if erased:
        left = content[:at].ljust(len(content), _ERASED)
        return record_id, left[:_COUNT] + content[_COUNT:_ENTRIES] + left[_ENTRIES:]
    count = max(0, at - _ENTRIES) // _ENTRY[kind]
    left = content[:at].ljust(_ENTRIES, b"\0")
    entries = left[_ENTRIES : _ENTRIES + count * _ENTRY[kind]]
    return record_id, left[:_COUNT] + count.to_bytes(2, byte_order) + entries
