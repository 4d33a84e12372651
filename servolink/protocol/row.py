"""Conversion of rows, consecutive values in a single `struct` format, to bytes and back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import starmap
from operator import itemgetter
from struct import Struct as Format
from struct import error as struct_error
from typing import Any

from msgspec import Struct as Record
from msgspec.structs import astuple

from servolink.errors import EncodeError
from servolink.protocol.caption import decode_caption, decode_captions, encode_caption, encode_captions
from servolink.protocol.packet import Value

Reader = Callable[[bytes, int, str], tuple[Any, ...]]
"""Reads a group. Arguments: content, position of the first row, encoding of captions."""


class Writing(Record, frozen=True):
    """Rules for writing values."""

    encoding: str
    plain: bool
    """Refuse captions with control characters or a hidden frame start, as in all packets composed by the library."""
    narrow: bool
    """Refuse numbers outside the declared range, not only numbers outside the range of the wire."""


class Row:
    """Sequence of consecutive values."""

    def __init__(self, values: list[Value], prefix: str, suffix: str = "") -> None:
        """Lay out `values` in the byte order of `prefix`; `suffix` is the code of a count at the end."""
        self.values = values
        self._prefix = prefix
        self.format = Format(prefix + "".join(value.code for value in values) + suffix)
        self.captions = tuple(at for at, value in enumerate(values) if value.is_caption)
        self.caption_starts = tuple(
            Format(prefix + "".join(each.code for each in values[:at])).size for at in self.captions
        )
        # Only numbers with a range narrower than on the wire: struct itself checks the others.
        self._narrow = tuple((at, value.low, value.high) for at, value in enumerate(values) if value.narrow)
        self.free = not self.captions and not self._narrow  # struct checks everything

    def in_range(self, row: Sequence[Any]) -> bool:
        """Return whether all numbers are in their declared range. Raise TypeError for anything but a number."""
        for at, low, high in self._narrow:  # noqa: SIM110 - all() of a generator costs several times as much
            if not low <= row[at] <= high:
                return False
        return True

    def pack(self, values: Sequence[Any], path: str, how: Writing, count: tuple[int, ...] = ()) -> bytes:
        """Return the bytes of `values` and `count`. Raise EncodeError naming each unsuitable value."""
        if self.free:
            try:
                return self.format.pack(*values, *count)
            except (struct_error, TypeError):
                pass
        row = [*values]
        for at in self.captions:
            row[at] = encode_caption(row[at], how.encoding, _inside(path, self.values[at].name), from_us=how.plain)
        try:
            if not how.narrow or self.in_range(row):
                return self.format.pack(*row, *count)
        except (struct_error, TypeError):
            pass
        (first, text), *others = (
            (_inside(path, declared.name), fault)
            for declared, value in zip(self.values, row, strict=True)
            if not declared.is_caption and (fault := declared.fault(value))
        )
        raise EncodeError("; ".join([text, *(f"{other}: {fault}" for other, fault in others)]), first)

    def pack_group(self, group: Sequence[Any], record: type[Record] | None, path: str, how: Writing) -> bytes:
        """Return the bytes of many rows, each a `record` or a plain number. Raise EncodeError like `pack`."""
        try:
            packed = self._pack_at_once(group, record, how)
        except (struct_error, TypeError, EncodeError):
            packed = None
        return self._pack_one_by_one(group, record, path, how) if packed is None else packed

    def _pack_at_once(self, group: Sequence[Any], record: type[Record] | None, how: Writing) -> bytes | None:
        """Pack a group several times as fast as value by value; return None or fail if a value may be unsuitable."""
        if record is None:
            return self._bare(len(group)).pack(*group) if self.free else None
        if not {*map(type, group)} <= {record}:
            return None
        rows: list[Any] = [*map(astuple, group)]
        for at, low, high in self._narrow if group and how.narrow else ():
            numbers = [*map(itemgetter(at), rows)]
            if min(numbers) < low or max(numbers) > high:
                return None
        if group and self.captions:
            columns: list[Sequence[Any]] = [*zip(*rows, strict=True)]
            for at in self.captions:
                columns[at] = encode_captions(columns[at], how.encoding, from_us=how.plain)
            return b"".join(map(self.format.pack, *columns))
        return b"".join(starmap(self.format.pack, rows))

    def _bare(self, count: int) -> Format:
        """Return the format of `count` plain numbers."""
        return Format(f"{self._prefix}{count}{self.values[0].code}")

    def _pack_one_by_one(self, group: Sequence[Any], record: type[Record] | None, path: str, how: Writing) -> bytes:
        parts = []
        for at, item in enumerate(group):
            if record is None:
                row: tuple[Any, ...] = (item,)
            elif isinstance(item, record):
                row = tuple(getattr(item, value.name) for value in self.values)
            else:
                raise EncodeError(f"must be a {record.__name__}, not {type(item).__name__}", f"{path}[{at}]")
            parts.append(self.pack(row, f"{path}[{at}]", how))
        return b"".join(parts)

    def text(self, row: list[Any], encoding: str) -> list[Any]:
        """Decode the captions of `row` in place, and return `row`."""
        for at in self.captions:
            row[at] = decode_caption(row[at], encoding)
        return row

    def reader(self, record: type[Record] | None) -> Reader:
        """Return the function to read whole rows as records, or as plain numbers."""
        rows, size, captions = self.format.iter_unpack, self.format.size, self.captions
        if record is None:
            return lambda content, start, encoding: self._bare((len(content) - start) // size).unpack(content[start:])
        if not captions:
            return lambda content, start, encoding: (*starmap(record, rows(content[start:])),)
        prefix, codes, width = self._prefix, self.format.format[1:], len(self.values)

        def read(content: bytes, start: int, encoding: str) -> tuple[Any, ...]:
            count = (len(content) - start) // size
            values = Format(prefix + codes * count).unpack_from(content, start)
            columns: list[Sequence[Any]] = [values[at::width] for at in range(width)]
            for at in captions:
                columns[at] = decode_captions(columns[at], encoding)
            return tuple(map(record, *columns))

        return read


def _inside(path: str, name: str) -> str:
    """Return the path of a field; a plain number has no name."""
    return ".".join(filter(None, (path, name)))
