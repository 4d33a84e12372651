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

MAGIC = b"\x89MCAP0\r\n"
_MESSAGE = struct.Struct("<BQHIQQ")
_OPCODE = 5
_FOOTER = struct.Struct("<BQQQ")
_FOOTER_OPCODE = 0x02
_SCHEMAS, _CHANNELS, _STATISTICS, _CHUNK_INDEXES, _METADATA_INDEXES = 0x03, 0x04, 0x0B, 0x08, 0x0D
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
        self._index: dict[str, list[tuple[int, int]]] = {}
        self._times = (0, 0)
        self._latest = 0
        self._ids = {topic: number for number, topic in enumerate(CHANNELS, 1)}
        self._counts = dict.fromkeys(CHANNELS, 0)
        self._first = 0
        self._chunks = 0
        self._chunk_indexes: Any = self._build()  # as bytes: a recording of a day has 86,400
        self._metadata: list[Any] = []

    @property
    def waiting(self) -> int:
        """Bytes of all messages not yet in a chunk."""
        return len(self._chunk)

    def head(self) -> bytes:
        """Return the beginning of the file: metadata and channels."""
        records, builder = self._records, self._build()
        records.Header("", f"servolink {version('servolink')}").write(builder)
        start = len(MAGIC) + builder.count
        records.Metadata(METADATA, msgspec.to_builtins(self._about)).write(builder)
        self._metadata.append(records.MetadataIndex(start, len(MAGIC) + builder.count - start, METADATA))
        self._declare(builder)
        return self._made(MAGIC + builder.end())

    def add(self, topic: str, time: int, data: bytes) -> None:
        """Add a message; `time` is in nanoseconds since 1970, raised to the previous time if earlier."""
        self._latest = time = max(time, self._latest)
        start = len(self._chunk)
        if not start:
            self._times = (time, time)
        self._index.setdefault(topic, []).append((time, start))
        count = self._counts[topic]
        self._chunk += _MESSAGE.pack(_OPCODE, _HEAD + len(data), self._ids[topic], count & 0xFFFFFFFF, time, time)
        self._chunk += data
        self._counts[topic] = count + 1
        if not self.messages:
            self._first = time
        self.messages += 1

    def chunk(self) -> bytes:
        """Return the messages added since the previous chunk; empty without messages."""
        if not self._chunk:
            return b""
        records, builder = self._records, self._build()
        content, started = bytes(self._chunk), self._times[0]
        packed = self._compress(content)
        records.Chunk("zstd", packed, self._latest, started, zlib.crc32(content), len(content)).write(builder)
        length, offsets = builder.count, {}
        for topic, entries in self._index.items():
            offsets[self._ids[topic]] = self._size + builder.count
            records.MessageIndex(self._ids[topic], entries).write(builder)
        records.ChunkIndex(
            chunk_start_offset=self._size,
            chunk_length=length,
            message_start_time=started,
            message_end_time=self._latest,
            message_index_offsets=offsets,
            message_index_length=builder.count - length,
            compression="zstd",
            compressed_size=len(packed),
            uncompressed_size=len(content),
        ).write(self._chunk_indexes)
        self._chunks += 1
        self._chunk.clear()
        self._index.clear()
        return self._made(builder.end())

    def end(self) -> bytes:
        """Return the end of the file, with an index for tools to find any time. No message can be added afterwards."""
        records, builder = self._records, self._build()
        records.DataEnd(0).write(builder)
        start, end, offsets = self._size + builder.count, builder.end(), list[Any]()

        def end_group(opcode: int, before: int) -> None:
            where = {"group_start": start + before, "group_length": builder.count - before}
            offsets.append(records.SummaryOffset(group_opcode=opcode, **where))

        def group(opcode: int, found: list[Any]) -> None:
            before = builder.count
            for record in found:
                record.write(builder)
            end_group(opcode, before)

        group(_SCHEMAS, self._schemas())
        group(_CHANNELS, self._channels())
        group(_STATISTICS, [self._statistics()])
        before = builder.count
        builder.write(self._chunk_indexes.end())
        end_group(_CHUNK_INDEXES, before)
        group(_METADATA_INDEXES, self._metadata)
        offsets_start = start + builder.count
        for offset in offsets:
            offset.write(builder)
        summary = builder.end()
        footer = _FOOTER.pack(_FOOTER_OPCODE, 20, start, offsets_start)
        crc = zlib.crc32(footer, zlib.crc32(summary))
        return self._made(end + summary + footer + crc.to_bytes(4, "little") + MAGIC)

    def _made(self, data: bytes) -> bytes:
        self._size += len(data)
        return data

    def _declare(self, builder: Any) -> None:
        for record in (*self._schemas(), *self._channels()):
            record.write(builder)

    def _schemas(self) -> list[Any]:
        make, ids = self._records.Schema, self._ids
        return [make(number, schema(topic), SCHEMA_ENCODING, SCHEMA_NAMES[topic]) for topic, number in ids.items()]

    def _channels(self) -> list[Any]:
        make = self._records.Channel
        return [make(number, topic, MESSAGE_ENCODING, {}, number) for topic, number in self._ids.items()]

    def _statistics(self) -> Any:
        return self._records.Statistics(
            attachment_count=0,
            channel_count=len(self._ids),
            channel_message_counts={self._ids[topic]: count for topic, count in self._counts.items() if count},
            chunk_count=self._chunks,
            message_count=self.messages,
            message_end_time=self._latest,
            message_start_time=self._first,
            metadata_count=1,
            schema_count=len(self._ids),
        )
