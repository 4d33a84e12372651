"""Recipes: bytes that a fuzzer changes as it likes, read as instructions for a stream of frames.

Changed bytes alone hardly ever make a right checksum, so raw streams never come past it. What a recipe makes is right
wherever it does not say otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

from servolink.protocol import (
    HEADER,
    MAGIC,
    PACKETS,
    ByteOrder,
    Frame,
    LengthRule,
    Response,
    SendDummyDataRequest,
    encode_frame,
    layout,
)

IDS = tuple(sorted(PACKETS))
RESPONSE_IDS = tuple(packet_id for packet_id in IDS if issubclass(PACKETS[packet_id], Response))

_DUMMY = SendDummyDataRequest.packet_id
_COUNT_SIZES = {"B": 1, "H": 2}
_MOST_RECORDS = 24


class Cursor:
    """Reads a recipe; past its end it reads zeros."""

    def __init__(self, recipe: bytes, at: int = 0) -> None:
        self._recipe = recipe
        self._at = at

    @property
    def left(self) -> int:
        """The number of bytes not read yet."""
        return max(0, len(self._recipe) - self._at)

    def byte(self) -> int:
        """Read one byte."""
        at = self._at
        self._at += 1
        return self._recipe[at] if at < len(self._recipe) else 0

    def take(self, size: int) -> bytes:
        """Read `size` bytes."""
        at = self._at
        self._at += size
        return self._recipe[at : self._at].ljust(size, b"\0")


@dataclass
class Made:
    """The stream made by a recipe."""

    pieces: list[bytes] = field(default_factory=list)
    frames: list[Frame] = field(default_factory=list)
    """The intact frames in order."""
    clean: bool = True
    """Whether the stream has only intact frames."""
    apart: bool = True
    """Whether nothing between the intact frames can be the beginning of another."""

    @property
    def stream(self) -> bytes:
        """All the bytes."""
        return b"".join(self.pieces)


def made(cursor: Cursor, byte_order: ByteOrder) -> Made:
    """Return the stream that a recipe describes."""
    result = Made()
    while cursor.left:
        _add_piece(result, cursor, byte_order)
    return result


def content_for(cursor: Cursor, packet_id: int, byte_order: ByteOrder) -> bytes:
    """Read a content that obeys the length rule of its packet, mostly with the right count."""
    rule, count_size = shape(packet_id, byte_order)
    how = cursor.byte()
    records = min(how % 64 % (_MOST_RECORDS + 1), rule.limit) if rule.unit else 0
    content = cursor.take(rule.base + rule.unit * records)
    if count_size and how < 224:
        at = rule.base - count_size
        return content[:at] + records.to_bytes(count_size, byte_order) + content[rule.base :]
    return content


def _add_piece(result: Made, cursor: Cursor, byte_order: ByteOrder) -> None:
    kind = cursor.byte()
    if kind < 128:
        packet_id = IDS[cursor.byte() % len(IDS)]
        content = content_for(cursor, packet_id, byte_order)
        result.frames.append((packet_id, content))
        result.pieces.append(encode_frame(packet_id, content, byte_order))
        return
    result.clean = False
    piece = _no_frame(kind, result, cursor, byte_order)
    result.apart = result.apart and MAGIC[0] not in piece
    result.pieces.append(piece)


def _no_frame(kind: int, result: Made, cursor: Cursor, byte_order: ByteOrder) -> bytes:
    """Return noise, padding, a damaged or cut frame, a false start, or a frame around the last one."""
    last = result.pieces[-1] if result.pieces else b""
    match kind >> 4:
        case 8 | 9:
            return cursor.take(1 + cursor.byte() % 40)
        case 10:
            return bytes(1 + cursor.byte())
        case 11:
            at, flipped = cursor.byte(), 1 << kind % 8
            at %= max(1, len(last))
            return last[:at] + bytes(byte ^ flipped for byte in last[at : at + 1]) + last[at + 1 :]
        case 12:
            return last[: cursor.byte()]
        case 13:
            return last[cursor.byte() :]
        case 14:
            return HEADER[byte_order].pack(MAGIC, IDS[cursor.byte() % len(IDS)], cursor.byte() * 256 + cursor.byte())
        case _:
            return encode_frame(_DUMMY, cursor.take(kind % 8) + last[: 1 << 12] + cursor.take(kind % 3), byte_order)


@cache
def shape(packet_id: int, byte_order: ByteOrder) -> tuple[LengthRule, int]:
    """Return the length rule of a packet, and the size of its count at the end of the fixed part."""
    found = layout(PACKETS[packet_id], byte_order)
    return found.rule, next((_COUNT_SIZES[field.code] for field in found.fields if field.items), 0)
