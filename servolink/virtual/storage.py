"""Memory of the virtual board: actions, macros, joystick tables, servo parameters, project id, active table.

Records are stored as received bytes, for two reasons: a board returns records byte for byte, even with captions of
invalid text; and the memory of a record is simply its length. No translation is necessary either: the content of an
"add" request is also the content of the response with the record.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import zip_longest
from random import Random
from typing import Any, TypeAlias

from msgspec import Struct, field
from msgspec.structs import replace

from servolink.protocol import (
    SERVO_PARAMETER,
    STORED_TYPES,
    TABLE,
    AddServoParameterRequest,
    ByteOrder,
    Codec,
    Packet,
    QueryServoRequest,
    RecordType,
    ServoParameter,
    StoredType,
    layout,
)
from servolink.virtual.kind import BoardKind, OnDuplicate

AnyType: TypeAlias = StoredType[Any]
Record: TypeAlias = tuple[int, bytes]
"""Id and content of a record."""


def _nothing() -> dict[AnyType, tuple[Record, ...]]:
    return dict.fromkeys(STORED_TYPES, ())


class Contents(Struct, frozen=True):
    """Immutable contents of the memory at one moment; a write makes new contents."""

    records: Mapping[AnyType, tuple[Record, ...]] = field(default_factory=_nothing)
    """Records of each type in the order of adding; a replacement takes the place of the old record.

    A record which is another object in the next contents was written again, even with the same bytes."""
    project_id: int = 0
    chosen_table: int = 0
    """Id of the activated table, 0 before any activation."""

    @property
    def size(self) -> int:
        """Size of all records, in bytes."""
        return sum([len(record) for records in self.records.values() for _, record in records])


class Storage:
    """Memory of a board, with the rules of its kind for changes."""

    def __init__(self, kind: BoardKind) -> None:
        """Start with empty contents."""
        self.memory = kind.memory
        """Size of the memory, in bytes."""
        self.used = 0
        """Used memory, in bytes."""
        self._contents = Contents()
        self._kind = kind

    @property
    def contents(self) -> Contents:
        """Present contents. Earlier contents can be assigned to restore an earlier moment."""
        return self._contents

    @contents.setter
    def contents(self, contents: Contents) -> None:
        self._contents = contents
        self.used = contents.size

    @property
    def free(self) -> int:
        """Free memory, in bytes."""
        return self.memory - self.used

    @property
    def project_id(self) -> int:
        """Project id, 0 before the first write."""
        return self.contents.project_id

    @project_id.setter
    def project_id(self, project_id: int) -> None:
        bits = self._kind.project_id_bits
        kept = project_id if bits == 32 else project_id & ((1 << bits) - 1)
        self.contents = replace(self.contents, project_id=kept)

    @property
    def active_table(self) -> int:
        """Id of the activated table, else of the only table, else 0."""
        tables = {record_id for record_id, _ in self.all(TABLE)}
        if self.contents.chosen_table in tables:
            return self.contents.chosen_table
        return tables.pop() if len(tables) == 1 else 0

    def activate(self, table_id: int) -> bool:
        """Activate a table; return False for a missing table."""
        if self.get(TABLE, table_id) is None:
            return False
        self.contents = replace(self.contents, chosen_table=table_id)
        return True

    def put(
        self, stored_type: AnyType, records: Mapping[int, bytes], *, on_duplicate: OnDuplicate | None = None
    ) -> bool:
        """Add all `records`; add none and return False if a record is refused or memory is short.

        Servo parameters always replace the parameters of the same servo, as no request deletes parameters. Nothing can
        be stored under the id 0, which means "no such record" in every response.
        """
        if stored_type is SERVO_PARAMETER:
            on_duplicate = "replace"
        elif on_duplicate is None:
            on_duplicate = self._kind.on_duplicate
        kept = self.all(stored_type)
        known = set[int]() if on_duplicate == "append" else {record_id for record_id, _ in kept} & records.keys()
        if 0 in records or (known and on_duplicate == "reject"):
            return False
        added = tuple([new for new in records.items() if new[0] not in known])
        used = self.used + sum(
            [len(record) for _, record in added]
        )  # not counted again for all records: boards are filled record by record
        if known:
            used += sum([len(records[record_id]) - len(old) for record_id, old in kept if record_id in known])
            kept = tuple([(old[0], records[old[0]]) if old[0] in known else old for old in kept])
        if used > self.memory:
            return False
        self._contents, self.used = self._with(stored_type, kept + added), used
        return True

    def get(self, stored_type: AnyType, record_id: int) -> bytes | None:
        """Return the first record with the id; None for an unknown id."""
        return next((record for stored_id, record in self.all(stored_type) if stored_id == record_id), None)

    def decode(self, record_type: RecordType[Any], record_id: int, codec: Codec) -> Packet | None:
        """Return a request to store a record again; None for an unknown id."""
        content = self.get(record_type, record_id)
        return None if content is None else codec.decode(record_type.add_class.packet_id, content)

    def all(self, stored_type: AnyType) -> tuple[Record, ...]:
        """Return all records of a type, in order."""
        return self.contents.records[stored_type]

    def servo_content(self, byte_order: ByteOrder) -> bytes:
        """Return the content of a request to store all servo parameters again."""
        records = [record for _, record in self.all(SERVO_PARAMETER)]
        count = len(records).to_bytes(layout(SERVO_PARAMETER.add_class, "little").size(), byte_order)
        return count + b"".join(records)

    def servo_parameters(self, codec: Codec) -> tuple[ServoParameter, ...]:
        """Return the decoded parameters of all servos."""
        content = self.servo_content(codec.byte_order)
        request = codec.decode(SERVO_PARAMETER.add_class.packet_id, content)
        return request.servos if isinstance(request, AddServoParameterRequest) else ()

    def delete(self, stored_type: AnyType, record_id: int) -> bool:
        """Delete the first record with the id; return False for an unknown id."""
        stored = self.all(stored_type)
        at = next((at for at, (stored_id, _) in enumerate(stored) if stored_id == record_id), None)
        if at is None:
            return False
        self.contents = self._with(stored_type, stored[:at] + stored[at + 1 :])
        if stored_type is TABLE and record_id == self.contents.chosen_table and self.get(TABLE, record_id) is None:
            self.contents = replace(self.contents, chosen_table=0)
        return True

    def clear(self) -> None:
        """Delete everything, or all but project id and servo parameters, depending on the kind of board."""
        if self._kind.clear == "all":
            self.contents = Contents()
        else:
            self.contents = Contents({**_nothing(), SERVO_PARAMETER: self.all(SERVO_PARAMETER)}, self.project_id)

    def _with(self, stored_type: AnyType, records: tuple[Record, ...]) -> Contents:
        """Return the contents with the records of one type replaced."""
        now = self.contents
        return Contents({**now.records, stored_type: records}, now.project_id, now.chosen_table)


def servo_parameters(request: AddServoParameterRequest, content: bytes) -> dict[int, bytes]:
    """Return the record of each servo in the content of `request`; for a duplicate, the last record."""
    rule = layout(AddServoParameterRequest, "little").rule
    records = [content[at : at + rule.unit] for at in range(rule.base, len(content), rule.unit)]
    return dict(zip([servo.servo_id for servo in request.servos], records, strict=True))


_Place: TypeAlias = tuple[Record | None, Record | None]
"""Place in the flash: the record before and the record after a write."""


def partial_write(before: Contents, after: Contents, random: Random, byte_order: ByteOrder) -> Contents:
    """Return possible contents after an interrupted write from `before` to `after`.

    A write changes records one by one, in any order, and power is lost during the change of one record or after the
    last. Earlier changes are complete, later changes have not begun. The record in question is in any of these states:
    old, old and half erased, missing, new and half written. Project id and active table are words, written at once:
    each has the old or the new value.
    """
    places = {each: list(_places(before.records[each], after.records[each])) for each in STORED_TYPES}
    changes = [(each, at) for each in STORED_TYPES for at, (old, new) in enumerate(places[each]) if old is not new]
    random.shuffle(changes)
    # Power is lost during the change with number 0, after all changes with negative numbers.
    for number, (each, at) in enumerate(changes, start=-random.randint(0, len(changes))):
        old, _ = places[each][at]
        if number == 0:
            places[each][at] = (old, _interrupted(each, places[each][at], random, byte_order))
        elif number > 0:
            places[each][at] = (old, old)
    return Contents(
        {each: tuple([left for _, left in places[each] if left is not None]) for each in STORED_TYPES},
        random.choice((before.project_id, after.project_id)),
        random.choice((before.chosen_table, after.chosen_table)),
    )


def _places(before: tuple[Record, ...], after: tuple[Record, ...]) -> Iterator[_Place]:
    """Yield each record before the write with its successor, then all added records."""
    if len(after) >= len(before):  # a new record takes the place of the old record
        yield from zip_longest(before, after)
        return
    left = list(after)
    for record in before:
        yield (record, left.pop(0)) if left and left[0] is record else (record, None)


def _interrupted(stored_type: AnyType, place: _Place, random: Random, byte_order: ByteOrder) -> Record | None:
    """Return a random state of a record during a write."""
    halves = [_without_tail(stored_type, record, random, byte_order) for record in place if record is not None]
    return random.choice([*dict.fromkeys((place[0], None)), *halves])


def _without_tail(stored_type: AnyType, record: Record, random: Random, byte_order: ByteOrder) -> Record:
    """Return `record` with its tail erased or missing; the id and a correct count of parts remain.

    The board has id and length of each record in a separate directory, so that responses remain valid frames.
    """
    record_id, content = record
    rule = layout(stored_type.add_class, byte_order).rule
    is_erased = random.random() < 0.5
    if not isinstance(stored_type, RecordType):  # parameters of a servo have no counted parts
        at = random.randrange(layout(QueryServoRequest, "little").size(), len(content))
        return record_id, content[:at].ljust(len(content), b"\xff" if is_erased else b"\0")
    at = random.randrange(layout(stored_type.query_class, "little").size(), len(content))
    parts = rule.base  # position of the first part, directly after the count
    count = layout(AddServoParameterRequest, "little").size()  # of a count: without parameters, there is nothing else
    if is_erased:
        left = content[:at].ljust(len(content), b"\xff")
        return record_id, left[: parts - count] + content[parts - count : parts] + left[parts:]
    whole = max(0, at - parts) // rule.unit
    left = content[:at].ljust(parts, b"\0")[: parts + whole * rule.unit]
    return record_id, left[: parts - count] + whole.to_bytes(count, byte_order) + left[parts:]
