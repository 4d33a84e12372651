"""What the board keeps: actions, macros, joystick tables, servo parameters, project id, active table.

Records are kept as the bytes that came, for two reasons: a board gives back what it was given, byte for byte,
also captions that are no text; and what it takes of the memory is then simply its length. It costs no
translation either: the content of an "add" request is the content of the answer that gives the record back.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import zip_longest
from random import Random
from typing import Literal, TypeAlias, get_args

from servolink.protocol.frame import ByteOrder


class Kind(StrEnum):
    """The kinds of records."""

    ACTION = "action"
    MACRO = "macro"
    TABLE = "table"
    SERVO = "servo"


OnDuplicate = Literal["replace", "append", "reject"]
"""What becomes of a record whose id is stored already: it replaces the other, is stored besides it, or is refused."""
Clear = Literal["all", "records"]
"""What clearing clears: everything, or all but project id and servo parameters."""
ON_DUPLICATE: tuple[OnDuplicate, ...] = get_args(OnDuplicate)
CLEAR: tuple[Clear, ...] = get_args(Clear)

Record: TypeAlias = tuple[int, bytes]
"""Id and content."""


def _nothing() -> dict[Kind, tuple[Record, ...]]:
    return dict.fromkeys(Kind, ())


@dataclass(frozen=True, slots=True)
class Contents:
    """All that is stored at one moment; it never changes, a write makes another."""

    records: Mapping[Kind, tuple[Record, ...]] = field(default_factory=_nothing)
    """In the order in which they were added; one that replaces another takes its place.

    A record that is not the same object in the next contents was written anew, if only with the same bytes."""
    project_id: int = 0
    chosen_table: int = 0
    """The table that was made active, 0 if none was."""

    @property
    def size(self) -> int:
        """Bytes of all records."""
        return sum([len(record) for records in self.records.values() for _, record in records])


class Storage:
    """The contents, within `memory` bytes, and how they change."""

    def __init__(self, memory: int, *, on_duplicate: OnDuplicate = "replace", clear: Clear = "all") -> None:
        """Have nothing stored; ValueError if `on_duplicate` or `clear` is none of its values."""
        if on_duplicate not in ON_DUPLICATE:
            raise ValueError(f"on_duplicate is {on_duplicate!r}, but must be one of {', '.join(ON_DUPLICATE)}")
        if clear not in CLEAR:
            raise ValueError(f"clear is {clear!r}, but must be one of {', '.join(CLEAR)}")
        self.memory = memory
        self.contents = Contents()
        """All that is stored: kept, and later set again, it brings that moment back."""
        self._on_duplicate: OnDuplicate = on_duplicate
        self._clear: Clear = clear

    @property
    def used(self) -> int:
        """Bytes used."""
        return self.contents.size

    @property
    def free(self) -> int:
        """Bytes not used."""
        return self.memory - self.used

    @property
    def project_id(self) -> int:
        """The project id, 0 if none was written."""
        return self.contents.project_id

    @project_id.setter
    def project_id(self, project_id: int) -> None:
        self.contents = replace(self.contents, project_id=project_id)

    @property
    def active_table(self) -> int:
        """Id of the table that was made active, else of the only one there is, else 0."""
        tables = {record_id for record_id, _ in self.all(Kind.TABLE)}
        if self.contents.chosen_table in tables:
            return self.contents.chosen_table
        return tables.pop() if len(tables) == 1 else 0

    def activate(self, table_id: int) -> bool:
        """Make a table the active one; False if there is no such table."""
        if self.get(Kind.TABLE, table_id) is None:
            return False
        self.contents = replace(self.contents, chosen_table=table_id)
        return True

    def put(self, kind: Kind, records: Mapping[int, bytes], *, on_duplicate: OnDuplicate | None = None) -> bool:
        """Add `records`, all of them or none; return False if they are refused or too large.

        Servo parameters always replace those of the same servo, as no request deletes them. The id 0 says "no such
        record" in every answer, so nothing can be stored under it.
        """
        if kind is Kind.SERVO:
            on_duplicate = "replace"
        elif on_duplicate is None:
            on_duplicate = self._on_duplicate
        stored = self.all(kind)
        known = {record_id for record_id, _ in stored} & records.keys()
        if 0 in records or (known and on_duplicate == "reject"):
            return False
        if known and on_duplicate == "replace":
            kept = tuple([(old[0], records[old[0]]) if old[0] in known else old for old in stored])
            added = tuple([new for new in records.items() if new[0] not in known])
        else:
            kept, added = stored, tuple(records.items())
        contents = self._with(kind, kept + added)
        if contents.size > self.memory:
            return False
        self.contents = contents
        return True

    def get(self, kind: Kind, record_id: int) -> bytes | None:
        """Return a record, of several with one id the first; None if there is none."""
        return next((record for stored_id, record in self.all(kind) if stored_id == record_id), None)

    def all(self, kind: Kind) -> tuple[Record, ...]:
        """Return all records of a kind."""
        return self.contents.records[kind]

    def delete(self, kind: Kind, record_id: int) -> bool:
        """Delete a record, of several with one id the first; False if there was none."""
        stored = self.all(kind)
        at = next((at for at, (stored_id, _) in enumerate(stored) if stored_id == record_id), None)
        if at is None:
            return False
        contents = self._with(kind, stored[:at] + stored[at + 1 :])
        self.contents = contents
        if kind is Kind.TABLE and record_id == contents.chosen_table and self.get(kind, record_id) is None:
            self.contents = replace(contents, chosen_table=0)
        return True

    def clear(self) -> None:
        """Forget everything, or all records but servo parameters, as this board does."""
        if self._clear == "all":
            self.contents = Contents()
        else:
            parameters = {**_nothing(), Kind.SERVO: self.all(Kind.SERVO)}
            self.contents = Contents(parameters, self.project_id)

    def _with(self, kind: Kind, records: tuple[Record, ...]) -> Contents:
        """Return the contents with other records of one kind."""
        now = self.contents
        return Contents({**now.records, kind: records}, now.project_id, now.chosen_table)


_Place: TypeAlias = tuple[Record | None, Record | None]
"""A record's place in the flash: what is there before a write, and behind it."""

_COUNT, _ENTRIES = 36, 38
"""Where the count of a record's entries begins, and where the entries do; servo parameters have none."""
_ENTRY = {Kind.ACTION: 5, Kind.MACRO: 12, Kind.TABLE: 49}
_ERASED = b"\xff"


def partial_write(before: Contents, after: Contents, random: Random, byte_order: ByteOrder) -> Contents:
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
