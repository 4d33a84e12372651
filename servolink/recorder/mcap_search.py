"""Find the records behind a damaged one, whose length cannot be trusted."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from servolink.files import MIB

_HEAD = 9  # bytes of a record before its content: kind and length
_FIXED = 40  # bytes in a chunk besides the name of its compression and its records
_CHUNK = re.compile(
    rb"\x06(?P<size>...[\x00\x01]\x00{4}).{28}(?P<compression>\x04\x00{3}zstd|\x03\x00{3}lz4|\x00{4})(?P<packed>.{8})",
    re.DOTALL,
)
_CHANNEL = re.compile(rb"\x04(?P<size>..\x00{6}).{4}[^\x00]\x00{3}/[a-z]{1,32}\x04\x00{3}json", re.DOTALL)
_LONGEST: Final = 64
"""Bytes that the longest match can have."""
_FIRST, _MOST = 512, MIB  # bytes looked at together: few at first, as the next record is mostly near


def find_record(read: Callable[[int], bytes], start: int, end: int) -> int | None:
    """Return where the next chunk or channel begins, None if there is none.

    `read` returns up to so many of the next bytes; the first of them is at `start`, and the file ends at `end`. What is
    found has lengths that agree with each other and with the end of the file: noise and compressed data have not.
    """
    window, amount = b"", _FIRST
    while part := read(amount):
        window += part
        found = [place for kind in (_CHUNK, _CHANNEL) if (place := _first(kind, window, end - start)) is not None]
        if found:
            return start + min(found)
        rest = window[-_LONGEST:]  # may be the beginning of a match
        start += len(window) - len(rest)
        window, amount = rest, min(2 * amount, _MOST)
    return None


def _first(kind: re.Pattern[bytes], window: bytes, left: int) -> int | None:
    """Return the place of the first record of a kind in `window`, behind whose beginning are `left` bytes."""
    found = kind.search(window)
    while found is not None:
        size = int.from_bytes(found["size"], "little")
        if found.start() + _HEAD + size <= left and (kind is _CHANNEL or _agrees(found, size)):
            return found.start()
        found = kind.search(window, found.start() + 1)
    return None


def _agrees(chunk: re.Match[bytes], size: int) -> bool:
    return size == _FIXED + len(chunk["compression"]) - 4 + int.from_bytes(chunk["packed"], "little")
