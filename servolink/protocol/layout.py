"""A packet's declaration, compiled: its content to and from values, and the lengths it may have.

A content is fixed fields, then at most one variable part: a counted group, the rest of the bytes, or an
optional last field. That covers all 60 packets, so nothing more general is built.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import starmap
from operator import index
from struct import Struct as Format
from struct import error as struct_error
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from msgspec import Meta
from msgspec import Struct as Record

from servolink.errors import DecodeError, EncodeError
from servolink.printable import shown
from servolink.protocol.caption import decode_caption, encode_caption
from servolink.protocol.fields import Counted, Wire
from servolink.protocol.frame import MAX_CONTENT, ByteOrder
from servolink.protocol.packet import Packet, Response


@dataclass(frozen=True, slots=True)
class LengthRule:
    """The content lengths a packet may have: `base + n * unit` with n from 0 to `limit`."""

    base: int
    unit: int = 0
    limit: int = 0

    def admits(self, length: int) -> bool:
        """Tell whether a content of `length` bytes obeys the rule."""
        if self.unit == 0 or length < self.base:
            return length == self.base
        count, rest = divmod(length - self.base, self.unit)
        return rest == 0 and count <= self.limit


@dataclass(frozen=True, slots=True)
class _Value:
    """One number or caption."""

    name: str
    code: str
    low: int
    high: int
    optional: bool = False

    def fault(self, value: object) -> str:
        """Say what is wrong with `value`, in words that follow the field's name; empty if nothing is."""
        try:
            fits = self.low <= index(value) <= self.high  # type: ignore[arg-type]
        except TypeError:
            return f"{shown(value)} is no integer"
        return "" if fits else f"{shown(value)} is outside {self.low}..{self.high}"


@dataclass(frozen=True, slots=True)
class _Writing:
    """How values are to be written."""

    encoding: str
    plain: bool
    """Captions have neither control characters nor a hidden frame start: what this library makes up itself."""
    narrow: bool
    """Numbers are within what their declaration allows, not only within what the wire carries."""


class _Row:
    """Consecutive values with one `struct` format."""

    def __init__(self, values: list[_Value], prefix: str, suffix: str = "") -> None:
        self.values = values
        self.format = Format(prefix + "".join(value.code for value in values) + suffix)
        self.captions = tuple(at for at, value in enumerate(values) if value.code == "32s")
        # Only where fewer values are allowed than fit the wire: the rest is checked by struct itself.
        wire = {code: _wire_range(code) for code in "BhiI"}
        self._narrow = tuple(
            (at, v.low, v.high) for at, v in enumerate(values) if v.code in wire and (v.low, v.high) != wire[v.code]
        )

    def pack(self, values: Iterable[Any], where: str, how: _Writing, count: tuple[int, ...] = ()) -> bytes:
        row = list(values)
        for at in self.captions:
            row[at] = encode_caption(row[at], how.encoding, f"{where}.{self.values[at].name}", from_us=how.plain)
        try:
            if not how.narrow or all(low <= row[at] <= high for at, low, high in self._narrow):
                return self.format.pack(*row, *count)
        except (struct_error, TypeError):
            pass
        faults = (
            f"{where}.{declared.name}".rstrip(".") + f": {fault}"
            for declared, value in zip(self.values, row, strict=True)
            if declared.code != "32s" and (fault := declared.fault(value))
        )
        raise EncodeError("; ".join(faults))

    def text(self, row: tuple[Any, ...], encoding: str) -> list[Any]:
        """Return `row` with its captions decoded."""
        values = list(row)
        for at in self.captions:
            values[at] = decode_caption(values[at], encoding)
        return values


class Layout:
    """How the content of one packet class is laid out in one byte order."""

    def __init__(self, declared: type[Packet], byte_order: ByteOrder) -> None:
        """Compile the declaration of `declared`."""
        self._packet: Callable[..., Packet] = declared
        self._name = declared.__name__
        self._from_us = not issubclass(declared, Response)
        prefix = "<" if byte_order == "little" else ">"
        hints = get_type_hints(declared, include_extras=True)
        names = list(declared.__struct_fields__)
        self._names = tuple(names)
        self._tail = ""
        last = hints[names[-1]] if names else None
        counted = _metadata(last, Counted)
        if counted is not None or _bare(last) is bytes:
            self._tail = names.pop()
        fixed = [_value(name, hints[name]) for name in names]
        self._optional = _Row([fixed.pop()], prefix) if fixed and fixed[-1].optional else None
        self._head = _Row(fixed, prefix, counted.count if counted else "")
        self._record: type[Record] | None = None
        self._item: _Row | None = None
        if counted is not None:
            self._record, self._item = _group(_bare(last), prefix)
        self.rule = self._rule(counted)
        self.decode = self._decoder()

    def _rule(self, counted: Counted | None) -> LengthRule:
        base = self._head.format.size
        if self._item is not None and counted is not None:
            unit = self._item.format.size
            return LengthRule(base, unit, min((MAX_CONTENT - base) // unit, _wire_range(counted.count)[1]))
        if self._tail:
            return LengthRule(base, 1, MAX_CONTENT - base)
        if self._optional is not None:
            return LengthRule(base, self._optional.format.size, 1)
        return LengthRule(base)

    def encode(self, packet: Packet, encoding: str, *, exact: bool = False) -> bytes:
        """Return the content of `packet`; EncodeError names the field whose value does not fit.

        `exact` writes whatever a board can have said, which is more than this library says by itself.
        """
        values = [getattr(packet, name) for name in self._names]
        how = _Writing(encoding, plain=self._from_us and not exact, narrow=not exact)
        if self._item is not None:
            return self._encode_group(values, how)
        if self._tail:
            return self._encode_rest(values, how)
        if self._optional is not None:
            last = values.pop()
            tail = b"" if last is None else self._optional.pack([last], self._name, how)
            return self._head.pack(values, self._name, how) + tail
        return self._head.pack(values, self._name, how)

    def _encode_rest(self, values: list[Any], how: _Writing) -> bytes:
        data = values.pop()
        if not isinstance(data, (bytes, bytearray, memoryview)):
            raise EncodeError(f"{self._name}.{self._tail}: {type(data).__name__} is not bytes")
        if len(data) > self.rule.limit:
            raise EncodeError(f"{self._name}.{self._tail}: {len(data)} bytes are outside 0..{self.rule.limit}")
        return self._head.pack(values, self._name, how) + bytes(data)

    def _encode_group(self, values: list[Any], how: _Writing) -> bytes:
        group, where = values.pop(), f"{self._name}.{self._tail}"
        if not isinstance(group, (tuple, list)):
            raise EncodeError(f"{where}: {type(group).__name__} is not a tuple")
        if len(group) > self.rule.limit:
            raise EncodeError(f"{where}: {len(group)} records are outside 0..{self.rule.limit}")
        assert self._item is not None  # noqa: S101 - narrows the type; the caller has asked
        parts = [self._head.pack(values, self._name, how, (len(group),))]
        for at, record in enumerate(group):
            if self._record is None:
                row: tuple[Any, ...] = (record,)
            elif isinstance(record, self._record):
                row = tuple(getattr(record, value.name) for value in self._item.values)
            else:
                raise EncodeError(f"{where}[{at}]: {type(record).__name__} is not {self._record.__name__}")
            parts.append(self._item.pack(row, f"{where}[{at}]", how))
        return b"".join(parts)

    def _decoder(self) -> Callable[[bytes, str], Packet]:
        """Return the decoder that fits this shape: content and caption encoding to packet."""
        if self._item is not None:
            return self._decode_group
        if self._tail:
            return self._decode_rest
        if self._optional is not None:
            return self._decode_optional
        if self._head.captions:
            raise TypeError(f"{self._name}: captions are decoded only before a group")
        return self._decode_fixed

    def _decode_fixed(self, content: bytes, encoding: str) -> Packet:
        try:
            return self._packet(*self._head.format.unpack(content))
        except struct_error:
            raise self.wrong_length(content) from None

    def _decode_rest(self, content: bytes, encoding: str) -> Packet:
        return self._packet(bytes(content))

    def _decode_optional(self, content: bytes, encoding: str) -> Packet:
        assert self._optional is not None  # noqa: S101 - narrows the type; _decoder has asked
        size = self._head.format.size
        if len(content) == size:
            return self._packet(*self._head.format.unpack(content))
        if len(content) == size + self._optional.format.size:
            return self._packet(
                *self._head.format.unpack_from(content), *self._optional.format.unpack_from(content, size)
            )
        raise self.wrong_length(content)

    def _decode_group(self, content: bytes, encoding: str) -> Packet:
        head, item = self._head, self._item
        assert item is not None  # noqa: S101 - narrows the type; _decoder has asked
        size = head.format.size
        if len(content) < size:
            raise self.wrong_length(content)
        *values, count = head.format.unpack_from(content)
        if len(content) != size + count * item.format.size:
            raise DecodeError(
                f"{self._name}: {count} {self._tail} take {size + count * item.format.size} bytes, "
                f"the content has {len(content)}",
                content,
            )
        if head.captions:
            values = head.text((*values,), encoding)
        rows: Iterator[Any] = item.format.iter_unpack(content[size:])
        if item.captions:
            rows = (item.text(row, encoding) for row in rows)
        if self._record is None:
            return self._packet(*values, tuple(value for (value,) in rows))
        return self._packet(*values, tuple(starmap(self._record, rows)))

    def fault(self, name: str, value: object) -> str:
        """Say what is wrong with `value` as the number `name`, of the packet or its records; empty if nothing is."""
        rows = [row for row in (self._head, self._item, self._optional) if row is not None]
        numbers = {number.name or self._tail: number for row in rows for number in row.values if number.code != "32s"}
        return numbers[name].fault(value) if name in numbers else ""

    def wrong_length(self, content: bytes) -> DecodeError:
        """Return the error for a content whose length breaks the rule."""
        rule = self.rule
        wanted = str(rule.base) if rule.unit == 0 else f"{rule.base} + n * {rule.unit}"
        return DecodeError(f"{self._name}: a content of {len(content)} bytes, not {wanted}", content)


@cache
def layout(declared: type[Packet], byte_order: ByteOrder) -> Layout:
    """Return the compiled layout of `declared`."""
    return Layout(declared, byte_order)


def _group(hint: Any, prefix: str) -> tuple[type[Record] | None, _Row]:
    """Return record class (None for bare numbers) and row of a group declared as `tuple[item, ...]`."""
    item = get_args(hint)[0]
    if isinstance(item, type) and issubclass(item, Record):
        hints = get_type_hints(item, include_extras=True)
        return item, _Row([_value(name, hints[name]) for name in item.__struct_fields__], prefix)
    return None, _Row([_value("", item)], prefix)


def _value(name: str, hint: Any) -> _Value:
    optional = types.NoneType in _choices(hint)
    wire = _metadata(hint, Wire)
    if wire is None:
        raise TypeError(f"{name}: {hint} says nothing of the wire")
    low, high = _wire_range(wire.code)
    for meta in _all_metadata(hint):
        if isinstance(meta, Meta):
            low = low if meta.ge is None else int(meta.ge)
            high = high if meta.le is None else int(meta.le)
    return _Value(name, wire.code, low, high, optional)


def _wire_range(code: str) -> tuple[int, int]:
    if code.endswith("s"):
        return 0, 0
    bits = 8 * Format("<" + code).size
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if code.islower() else (0, (1 << bits) - 1)


def _choices(hint: Any) -> tuple[Any, ...]:
    """Return the members of a union, looking through annotations; the hint itself if it is none."""
    bare = _bare(hint)
    return get_args(bare) if get_origin(bare) in (Union, types.UnionType) else (bare,)


def _bare(hint: Any) -> Any:
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def _all_metadata(hint: Any) -> list[Any]:
    found = list(hint.__metadata__) if get_origin(hint) is Annotated else []
    bare = _bare(hint)
    if get_origin(bare) in (Union, types.UnionType):
        for member in get_args(bare):
            found += _all_metadata(member)
    return found


def _metadata(hint: Any, kind: type) -> Any:
    return next((entry for entry in _all_metadata(hint) if isinstance(entry, kind)), None)
