"""Index of an MCAP file, by which other readers find messages: behind each chunk, and at the end of the file."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from servolink.recorder.mcap_reader import MAGIC

Entries: TypeAlias = Mapping[int, Sequence[tuple[int, int]]]
"""Time in nanoseconds since 1970, and place in the chunk, of each message, by the number of the channel."""

_FOOTER = struct.Struct("<BQQQ")
_FOOTER_OPCODE = 0x02
_SCHEMAS, _CHANNELS, _STATISTICS, _CHUNK_INDEXES, _METADATA_INDEXES = 0x03, 0x04, 0x0B, 0x08, 0x0D


class ChunkPlace(NamedTuple):
    """Place and size of a chunk in the file, in bytes."""

    start: int
    length: int
    compression: str
    packed: int
    unpacked: int


class McapIndex:
    """Index that grows with the file. It holds packed bytes: a recording of a day has 86,400 chunks."""

    def __init__(self) -> None:
        """Begin without any chunk."""
        from mcap import data_stream, records

        self.counts = Counter[int]()
        """Messages in the chunks so far, by the number of the channel."""
        self._records: Any = records
        self._build: Any = data_stream.RecordBuilder
        self._schemas = self._channels = b""
        self._declared = 0
        self._chunks = 0
        self._chunk_indexes = bytearray()
        self._packer = zlib.compressobj()
        self._metadata_indexes: Any = self._build()
        self._metadata = 0
        self._times = (0, 0)

    def declare(self, schemas: bytes, channels: bytes, count: int) -> None:
        """Take the records of `count` schemas and channels, which the end of the file repeats."""
        self._schemas, self._channels, self._declared = schemas, channels, count

    def add_metadata(self, name: str, start: int, length: int) -> None:
        """Take the place of metadata in the file."""
        self._records.MetadataIndex(start, length, name).write(self._metadata_indexes)
        self._metadata += 1

    def add_chunk(self, place: ChunkPlace, entries: Entries) -> bytes:
        """Take a chunk with these messages, and return the index behind the chunk."""
        builder, offsets = self._build(), dict[int, int]()
        first, last = times_of(entries)
        for channel, found in entries.items():
            offsets[channel] = place.start + place.length + builder.count
            self._records.MessageIndex(channel, list(found)).write(builder)
            self.counts[channel] += len(found)
        record = self._build()
        self._records.ChunkIndex(
            chunk_start_offset=place.start,
            chunk_length=place.length,
            message_start_time=first,
            message_end_time=last,
            message_index_offsets=offsets,
            message_index_length=builder.count,
            compression=place.compression,
            compressed_size=place.packed,
            uncompressed_size=place.unpacked,
        ).write(record)
        self._chunk_indexes += self._packer.compress(record.end())
        self._times = (self._times[0] if self._chunks else first, last)
        self._chunks += 1
        index: bytes = builder.end()
        return index

    def summary(self, start: int) -> bytes:
        """Return what follows the end of the data, at `start` in the file, to the end of the file."""
        builder = self._build()
        self._statistics().write(builder)
        groups = {
            _SCHEMAS: self._schemas,
            _CHANNELS: self._channels,
            _STATISTICS: builder.end(),
            _CHUNK_INDEXES: zlib.decompress(self._chunk_indexes + self._packer.copy().flush()),
            _METADATA_INDEXES: self._metadata_indexes.end(),
        }
        at = start
        for opcode, group in groups.items():
            self._records.SummaryOffset(group_opcode=opcode, group_start=at, group_length=len(group)).write(builder)
            at += len(group)
        summary = b"".join((*groups.values(), builder.end()))
        footer = _FOOTER.pack(_FOOTER_OPCODE, 20, start, at)
        return summary + footer + zlib.crc32(footer, zlib.crc32(summary)).to_bytes(4, "little") + MAGIC

    def _statistics(self) -> Any:
        first, last = self._times
        return self._records.Statistics(
            attachment_count=0,
            channel_count=self._declared,
            channel_message_counts=dict(sorted(self.counts.items())),
            chunk_count=self._chunks,
            message_count=self.counts.total(),
            message_end_time=last,
            message_start_time=first,
            metadata_count=self._metadata,
            schema_count=self._declared,
        )


def times_of(entries: Entries) -> tuple[int, int]:
    """Return the times of the first and of the last message of a chunk, whose messages are in order."""
    return min(found[0][0] for found in entries.values()), max(found[-1][0] for found in entries.values())
