"""Check of what other readers of a recording need, and `McapReader` does not: indexes, statistics and summary.

The index is made again from the chunks, and compared byte for byte: a wrong offset makes a file unreadable for others.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, Any, cast

from servolink.recorder.mcap_index import ChunkPlace, Entries, McapIndex, times_of
from servolink.recorder.mcap_reader import LARGEST, MAGIC, MESSAGE, UnusableChunk, decompress
from servolink.support import open_file

_HEADER, _SCHEMA, _CHANNEL, _CHUNK, _METADATA, _DATA_END = 0x01, 0x03, 0x04, 0x06, 0x0C, 0x0F
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")


class _Different(Exception):
    """The file is not as a recorder writes it."""


def has_sound_index(path: Path) -> bool:
    """Return whether other readers find all messages of a file that `McapReader` has read as whole. Raise OSError."""
    from mcap.exceptions import McapError

    with open_file(path) as file:
        try:
            _compare(file)
        except (_Different, UnusableChunk, McapError, struct.error, ValueError, IndexError):
            return False
    return True


def _compare(file: IO[bytes]) -> None:
    """Raise _Different, or an error of the library, for what others could not read."""
    from mcap import records

    index, made, declared = McapIndex(), {_SCHEMA: b"", _CHANNEL: b""}, 0
    _expect(file, MAGIC)
    while True:
        start, kind, record = _next(file)
        if kind == _HEADER:
            _read(records.Header, record)
        elif kind == _METADATA:
            index.add_metadata(_read(records.Metadata, record).name, start, len(record))
        elif kind in made:
            made[kind] += record
            declared += kind == _CHANNEL
            index.declare(made[_SCHEMA], made[_CHANNEL], declared)
        elif kind == _CHUNK:
            chunk = _read(records.Chunk, record)
            entries = _entries(decompress(chunk.compression, chunk.data, chunk.uncompressed_size))
            if (chunk.message_start_time, chunk.message_end_time) != times_of(entries):
                raise _Different
            place = ChunkPlace(start, len(record), chunk.compression, len(chunk.data), chunk.uncompressed_size)
            _expect(file, index.add_chunk(place, entries))
        elif kind == _DATA_END and record == _HEAD.pack(_DATA_END, 4) + bytes(4):
            break
        else:
            raise _Different
    _expect(file, index.summary(file.tell()))
    _expect(file, b"")


def _read(declared: Any, record: bytes) -> Any:
    """Return what a record says. Raise _Different if its inner lengths contradict its end."""
    from mcap.data_stream import ReadDataStream, RecordBuilder

    found, builder = declared.read(ReadDataStream(BytesIO(record[_HEAD.size :]))), cast("Any", RecordBuilder())
    found.write(builder)
    if builder.end() != record:
        raise _Different
    return found


def _expect(file: IO[bytes], data: bytes) -> None:
    """Raise _Different unless `data` follows in the file; without data, unless the file ends."""
    if file.read(max(len(data), 1)) != data:
        raise _Different


def _next(file: IO[bytes]) -> tuple[int, int, bytes]:
    """Return place, kind and bytes of the next record."""
    start, head = file.tell(), file.read(_HEAD.size)
    kind, size = _HEAD.unpack(head)
    if size > LARGEST:
        raise _Different
    return start, kind, head + file.read(size)


def _entries(data: bytes) -> Entries:
    """Return the time and place of each message in a chunk, by the number of the channel."""
    found: dict[int, list[tuple[int, int]]] = {}
    for at, content in _messages(data):
        channel, _, time, _ = _MESSAGE.unpack_from(content)
        found.setdefault(channel, []).append((time, at))
    return found


def _messages(data: bytes) -> Iterator[tuple[int, Any]]:
    """Yield place and content of each record in a chunk, all of which must be messages."""
    at, view = 0, memoryview(data)
    while at < len(data):
        kind, size = _HEAD.unpack_from(data, at)
        if kind != MESSAGE:
            raise _Different
        yield at, view[at + _HEAD.size : at + _HEAD.size + size]
        at += _HEAD.size + size
