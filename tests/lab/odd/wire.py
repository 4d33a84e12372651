"""Codec of odd boards, made from the transcribed document; it shares no code with the codec of servolink."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

ByteOrder = Literal["little", "big"]
Values = dict[str, Any]
"""Fields of a packet, by their names in the document; captions are 32 bytes."""

_DOCUMENT = json.loads(Path(__file__).with_name("protocol.json").read_text(encoding="utf-8"))
MAGIC = bytes.fromhex(_DOCUMENT["magic"])
FIELDS: dict[int, list[dict[str, Any]]] = {packet["id"]: packet["fields"] for packet in _DOCUMENT["packets"]}
"""Fields of each packet, by packet id."""
NAMES: dict[int, str] = {
    packet["id"]: packet["name"].removesuffix("Request")
    for packet in _DOCUMENT["packets"]
    if packet["direction"] == "client-to-server"
}
"""Name of each request, such as `QueryMemorySize`, by packet id."""

_CODES = {"u8": "B", "u16": "H", "u32": "I", "i16": "h", "i32": "i", "char[32]": "32s"}
_HEADER = 8
_LONGEST = 4096  # bytes in the longest request of a host


def encode(packet_id: int, values: Values, order: ByteOrder) -> bytes:
    """Return the content of a packet."""
    return b"".join(_encoded(FIELDS[packet_id], values, order))


def decode(packet_id: int, content: bytes, order: ByteOrder) -> Values:
    """Return the fields of a packet. Raise struct.error for missing bytes, KeyError for an unknown packet."""
    values, _ = _decoded(FIELDS[packet_id], content, 0, order)
    return values


def frame(packet_id: int, content: bytes, order: ByteOrder) -> bytes:
    """Return the frame around `content`."""
    body = MAGIC + struct.pack(f"{_mark(order)}HH", packet_id, len(content)) + content
    return body + bytes((sum(body) % 256,))


def _mark(order: ByteOrder) -> str:
    return "<" if order == "little" else ">"


def _encoded(fields: list[dict[str, Any]], values: Values, order: ByteOrder) -> Iterator[bytes]:
    for field in fields:
        if "repeat" in field:
            for record in values[field["name"]]:
                yield from _encoded(field["fields"], record, order)
        elif field["type"] == "bytes":
            yield values[field["name"]]
        else:
            yield struct.pack(_mark(order) + _CODES[field["type"]], values[field["name"]])


def _decoded(fields: list[dict[str, Any]], content: bytes, at: int, order: ByteOrder) -> tuple[Values, int]:
    values: Values = {}
    for field in fields:
        if "repeat" in field:
            records = []
            for _ in range(values[field["repeat"]]):
                record, at = _decoded(field["fields"], content, at, order)
                records.append(record)
            values[field["name"]] = records
        elif field["type"] == "bytes":
            values[field["name"]], at = content[at:], len(content)
        else:
            code = _mark(order) + _CODES[field["type"]]
            (values[field["name"]],) = struct.unpack_from(code, content, at)
            at += struct.calcsize(code)
    return values, at


class FrameReader:
    """Finds the frames in the bytes of a host."""

    def __init__(self, order: ByteOrder) -> None:
        self._order: ByteOrder = order
        self._bytes = b""

    def feed(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield packet id and content of each complete frame with a right checksum."""
        self._bytes += data
        while (start := self._bytes.find(MAGIC)) >= 0:
            self._bytes = self._bytes[start:]
            if len(self._bytes) < _HEADER:
                return
            packet_id, size = struct.unpack_from(f"{_mark(self._order)}HH", self._bytes, len(MAGIC))
            end = _HEADER + size + 1
            if size <= _LONGEST and len(self._bytes) < end:
                return
            if size <= _LONGEST and sum(self._bytes[: end - 1]) % 256 == self._bytes[end - 1]:
                content, self._bytes = self._bytes[_HEADER : end - 1], self._bytes[end:]
                yield packet_id, content
            else:
                self._bytes = self._bytes[1:]
        self._bytes = self._bytes[-len(MAGIC) + 1 :]
