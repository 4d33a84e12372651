"""Compiled declarations of packets: content to and from values, and the permitted lengths of a content.

A content has fixed fields, then at most one variable part: a counted group, the rest of the bytes, or an optional
last field. All 60 packets have such a form, so the compiler supports nothing more general.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache
from struct import error as struct_error
from typing import Any

from msgspec import Struct as Record
from msgspec.structs import astuple

from servolink.errors import DecodeError, EncodeError
from servolink.protocol.caption import CAPTION_SIZE
from servolink.protocol.frame import MAX_CONTENT, ByteOrder
from servolink.protocol.packet import (
    Counted,
    Packet,
    Response,
    bare,
    counted,
    description,
    field_hints,
    group,
    value,
    wire_range,
)
from servolink.protocol.row import Row, Writing

Decoder = Callable[[bytes, str], Packet]
"""Returns the packet for a content and a caption encoding. Raises DecodeError, with the content."""


class LengthRule(Record, frozen=True):
    """Permitted content lengths of a packet: `base + n * unit` with n from 0 to `limit`."""

    base: int
    unit: int = 0
    limit: int = 0

    def admits(self, length: int) -> bool:
        """Return whether a content of `length` bytes obeys the rule."""
        if self.unit == 0 or length < self.base:
            return length == self.base
        count, rest = divmod(length - self.base, self.unit)
        return rest == 0 and count <= self.limit


class Field(Record, frozen=True):
    """Declared field of a packet or a record."""

    name: str
    code: str
    """`struct` code, without byte order, of the value, or of the count of a group; empty for the rest of the bytes."""
    meaning: str
    """Description, such as "0 failed, 1 done"; empty if missing."""
    items: tuple[Field, ...] = ()
    """Fields of each item of a group; the only field of a plain number has the name of the group."""

    @classmethod
    def of(cls, name: str, hint: Any) -> Field:
        """Return the field declared by `hint`."""
        if bare(hint) is bytes:
            return cls(name, "", description(hint))
        if (count := counted(hint)) is None:
            return cls(name, value(name, hint).code, description(hint))
        record, values = group(hint)
        items = (cls(name, values[0].code, ""),) if record is None else cls.all_of(record)
        return cls(name, count.count, description(hint), items)

    @classmethod
    def all_of(cls, declared: type[Record]) -> tuple[Field, ...]:
        """Return the fields of a packet or a record."""
        return tuple(cls.of(name, hint) for name, hint in field_hints(declared).items())


class Layout:
    """Content of a packet class in a byte order."""

    def __init__(self, declared: type[Packet], byte_order: ByteOrder) -> None:
        """Compile the declaration of `declared`."""
        self._packet: Callable[..., Packet] = declared
        self._declared = declared
        self._name = declared.__name__
        self._from_us = not issubclass(declared, Response)  # captions of requests are composed here, so checked
        prefix = "<" if byte_order == "little" else ">"
        hints = field_hints(declared)
        names = list(hints)
        self._tail = ""  # name of the group, or of the rest of the bytes
        last = hints[names[-1]] if names else None
        count = counted(last)
        if count is not None or bare(last) is bytes:
            self._tail = names.pop()
        fixed = [value(name, hints[name]) for name in names]
        # An optional last field makes two rows: the head without the field, and the whole content.
        self._whole = Row(fixed, prefix) if fixed and fixed[-1].optional else None
        self._head = Row(fixed[:-1] if self._whole else fixed, prefix, count.count if count else "")
        self._record: type[Record] | None = None  # None for a group of plain numbers
        self._item: Row | None = None  # item of the group
        if count is not None:
            self._record, values = group(last)
            self._item = Row(values, prefix)
        self.rule = self._rule(count)
        # For most requests, with fixed numbers only, struct packs all fields in a single call.
        self._pack = self._head.format.pack if self.rule.unit == 0 and not self._head.captions else None
        self.decode: Decoder = self._decoder()

    def _rule(self, count: Counted | None) -> LengthRule:
        base = self._head.format.size
        if self._item is not None and count is not None:
            unit = self._item.format.size
            return LengthRule(base, unit, min((MAX_CONTENT - base) // unit, wire_range(count.count)[1]))
        if self._tail:
            return LengthRule(base, 1, MAX_CONTENT - base)
        if self._whole is not None:
            return LengthRule(base, self._whole.format.size - base, 1)
        return LengthRule(base)

    @property
    def fields(self) -> tuple[Field, ...]:
        """Fields of the packet, in the order of the wire."""
        return Field.all_of(self._declared)

    def size(self, count: int = 0) -> int:
        """Return the bytes of a content with `count` items in the group; frames add `frame.OVERHEAD`."""
        return self.rule.base + count * self.rule.unit

    def captions_in(self, content: bytes) -> list[bytes]:
        """Return the 32 bytes of each caption in `content`, padding included."""
        starts = list(self._head.caption_starts)
        if self._item is not None:
            base, unit = self._head.format.size, self._item.format.size
            ends = range(base, len(content) - unit + 1, unit)
            starts += [at + start for at in ends for start in self._item.caption_starts]
        return [content[at : at + CAPTION_SIZE] for at in starts]

    def encode(self, packet: Packet, encoding: str, *, unchecked: bool = False) -> bytes:
        """Return the content of `packet`. Raise EncodeError naming the unsuitable field.

        `unchecked` allows all values that a board can have sent: numbers outside the declared range within the range of
        the wire, and captions with control characters.
        """
        values = astuple(packet)
        if self._pack is not None:
            try:
                if unchecked or self._head.free or self._head.in_range(values):
                    return self._pack(*values)
            except (struct_error, TypeError):
                pass  # the slow way below names the unsuitable value
        how = _writing(encoding, self._from_us and not unchecked, not unchecked)
        try:
            return self._encode(values, how)
        except EncodeError as error:
            raise EncodeError(error.text, error.path, self._name) from None

    def _encode(self, values: tuple[Any, ...], how: Writing) -> bytes:
        if self._item is not None:
            return self._encode_group(self._item, values, how)
        if self._tail:
            return self._encode_rest(*values)
        if self._whole is not None and values[-1] is None:
            return self._head.pack(values[:-1], "", how)
        return (self._whole or self._head).pack(values, "", how)

    def _encode_rest(self, data: object) -> bytes:
        if not isinstance(data, (bytes, bytearray, memoryview)):
            raise EncodeError(f"must be bytes, not {type(data).__name__}", self._tail)
        if len(data) > self.rule.limit:
            raise EncodeError(f"{len(data)} bytes are outside 0..{self.rule.limit}", self._tail)
        return bytes(data)

    def _encode_group(self, item: Row, values: tuple[Any, ...], how: Writing) -> bytes:
        *fixed, records = values
        if not isinstance(records, (tuple, list)):
            raise EncodeError(f"must be a tuple, not {type(records).__name__}", self._tail)
        if len(records) > self.rule.limit:
            raise EncodeError(f"{len(records)} records are outside 0..{self.rule.limit}", self._tail)
        head = self._head.pack(fixed, "", how, (len(records),))
        return head + item.pack_group(records, self._record, self._tail, how)

    def _decoder(self) -> Decoder:
        """Return the decoder for the content of this packet class."""
        if self._item is not None:
            return self._group_decoder(self._item)
        if self._tail:
            if self._head.values:
                raise TypeError(f"{self._name}: data is supported only as the only field")
            return lambda content, encoding: self._packet(bytes(content))
        if self._head.captions:
            raise TypeError(f"{self._name}: captions are supported only in records and before a group")
        return self._fixed_decoder() if self._whole is None else self._optional_decoder(self._whole)

    def _fixed_decoder(self) -> Decoder:
        packet, unpack = self._packet, self._head.format.unpack

        def decode(content: bytes, encoding: str) -> Packet:
            try:
                return packet(*unpack(content))
            except struct_error:
                raise self._wrong_length(content) from None

        return decode

    def _optional_decoder(self, whole: Row) -> Decoder:
        packet, short, unpack, size = self._packet, self._fixed_decoder(), whole.format.unpack, whole.format.size

        def decode(content: bytes, encoding: str) -> Packet:
            return packet(*unpack(content)) if len(content) == size else short(content, encoding)

        return decode

    def _group_decoder(self, item: Row) -> Decoder:
        packet, head, read = self._packet, self._head, item.reader(self._record)
        unpack, base, unit = head.format.unpack_from, head.format.size, item.format.size

        def decode(content: bytes, encoding: str) -> Packet:
            try:
                *values, count = unpack(content)
            except struct_error:
                raise self._wrong_length(content) from None
            if len(content) != base + count * unit:
                raise self._wrong_count(content, count)
            return packet(*head.text(values, encoding), read(content, base, encoding))

        def decode_bare(content: bytes, encoding: str) -> Packet:
            try:
                (count,) = unpack(content)
            except struct_error:
                raise self._wrong_length(content) from None
            if len(content) != base + count * unit:
                raise self._wrong_count(content, count)
            return packet(read(content, base, encoding))

        return decode if head.values else decode_bare

    def documented(self, content: bytes) -> bytes:
        """Return the beginning of `content` that the document describes, if more than that was sent."""
        base, unit = self.rule.base, self.rule.unit
        if len(content) <= base:
            return content
        if self._item is not None:
            count = int(self._head.format.unpack_from(content)[-1])
        else:
            count = min(self.rule.limit, (len(content) - base) // unit) if unit else 0
        return content[: base + count * unit]

    def _wrong_length(self, content: bytes) -> DecodeError:
        """Return the error for a content length that breaks the rule."""
        rule = self.rule
        expected = str(rule.base) if rule.unit == 0 else f"{rule.base} + n * {rule.unit}"
        return DecodeError(f"{self._name}: the content has {len(content)} bytes, not {expected}", content)

    def _wrong_count(self, content: bytes, count: int) -> DecodeError:
        size = self.rule.base + count * self.rule.unit
        return DecodeError(
            f"{self._name}: {count} {self._tail} take {size} bytes, the content has {len(content)}", content
        )


@lru_cache(16)
def _writing(encoding: str, plain: bool, narrow: bool) -> Writing:  # noqa: FBT001 - only called here; names cost time
    return Writing(encoding, plain, narrow)


@cache
def layout(declared: type[Packet], byte_order: ByteOrder) -> Layout:
    """Return the compiled layout of `declared`."""
    return Layout(declared, byte_order)
