"""Conversion of messages to the bytes of an MCAP file, chunk by chunk.

The records are built by the library `mcap`. Only the messages inside a chunk are packed here: the library's writer
takes three times as long for each, and the time is taken from the recorded program.
"""

from __future__ import annotations

import struct
import zlib
from importlib.metadata import version
from typing import Any

import msgspec

from servolink.errors import RecordingError, install_extra
from servolink.recorder.channels import (
    CHANNELS,
    MESSAGE_ENCODING,
    METADATA,
    SCHEMA_ENCODING,
    SCHEMA_NAMES,
    Recorded,
    schema,
)
from servolink.recorder.mcap_index import ChunkPlace, McapIndex, times_of
from servolink.recorder.mcap_reader import MAGIC

_MESSAGE = struct.Struct("<BQHIQQ")
_OPCODE = 5
_HEAD = _MESSAGE.size - 9  # bytes of a message before the data, without opcode and length


class McapStream:
    """Bytes of a recording, to be written by the caller."""

    def __init__(self, about: Recorded) -> None:
        """Begin a file. Raise RecordingError naming the package to install if the library is missing."""
        try:
            import zstandard
            from mcap import data_stream, records
        except ImportError as error:
            raise RecordingError(f"a recording needs the extra record; {install_extra('record')} ({error})") from None
        self.messages = 0
        """Number of messages added so far."""
        self._records: Any = records
        self._build: Any = data_stream.RecordBuilder
        self._compress = zstandard.ZstdCompressor(level=3).compress
        self._about = about
        self._size = 0  # number of bytes made so far
        self._chunk = bytearray()
        self._entries: dict[int, list[tuple[int, int]]] = {}
        self._latest = 0
        self._ids = {topic: number for number, topic in enumerate(CHANNELS, 1)}
        self._index = McapIndex()

    @property
    def waiting(self) -> int:
        """Bytes of all messages not yet in a chunk."""
        return len(self._chunk)

    def head(self) -> bytes:
        """Return the beginning of the file: metadata and channels."""
        records, builder = self._records, self._build()
        records.Header("", f"servolink {version('servolink')}").write(builder)
        header = MAGIC + builder.end()
        records.Metadata(METADATA, msgspec.to_builtins(self._about)).write(builder)
        metadata = builder.end()
        self._index.add_metadata(METADATA, len(header), len(metadata))
        for topic, number in self._ids.items():
            records.Schema(number, schema(topic), SCHEMA_ENCODING, SCHEMA_NAMES[topic]).write(builder)
        schemas = builder.end()
        for topic, number in self._ids.items():
            records.Channel(number, topic, MESSAGE_ENCODING, {}, number).write(builder)
        channels = builder.end()
        self._index.declare(schemas, channels, len(self._ids))
        return self._made(header + metadata + schemas + channels)

    def add(self, topic: str, time: int, data: bytes) -> None:
        """Add a message; `time` is in nanoseconds since 1970, raised to the previous time if earlier."""
        self._latest = time = max(time, self._latest)
        number, start = self._ids[topic], len(self._chunk)
        entries = self._entries.setdefault(number, [])
        count = (self._index.counts[number] + len(entries)) & 0xFFFFFFFF
        entries.append((time, start))
        self._chunk += _MESSAGE.pack(_OPCODE, _HEAD + len(data), number, count, time, time)
        self._chunk += data
        self.messages += 1

    def chunk(self) -> bytes:
        """Return the messages added since the previous chunk; empty without messages."""
        if not self._chunk:
            return b""
        builder, content = self._build(), bytes(self._chunk)
        packed = self._compress(content)
        first, last = times_of(self._entries)
        self._records.Chunk("zstd", packed, last, first, zlib.crc32(content), len(content)).write(builder)
        chunk = builder.end()
        place = ChunkPlace(self._size, len(chunk), "zstd", len(packed), len(content))
        index = self._index.add_chunk(place, self._entries)
        self._chunk.clear()
        self._entries.clear()
        return self._made(chunk + index)

    def end(self) -> bytes:
        """Return the end of the file, with an index for tools to find any time. No message can be added afterwards."""
        builder = self._build()
        self._records.DataEnd(0).write(builder)
        end = builder.end()
        return self._made(end + self._index.summary(self._size + len(end)))

    def _made(self, data: bytes) -> bytes:
        self._size += len(data)
        return data
