"""Reader of MCAP records in files from any source: in order, in bounded memory, even when cut.

The file is read from the beginning to the end without following any offset, so that no loop is possible. Indexes,
attachments and other unneeded records are skipped unread. After a damaged record, the reader searches for the next
record.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from struct import Struct
from typing import Any, Final, NamedTuple

from servolink.errors import RecordingError, install_extra, quote
from servolink.support import MIB, open_file, reason

MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of a file."""
LARGEST = 16 * MIB
"""Largest record, and largest content of a chunk, accepted for reading; a recorder's chunks have 256 KiB."""

FOOTER, CHANNEL, MESSAGE, CHUNK, STATISTICS, METADATA = 0x02, 0x04, 0x05, 0x06, 0x0B, 0x0C
_IN_CHUNKS = {CHANNEL, MESSAGE}
_READ = {CHANNEL, MESSAGE, CHUNK, STATISTICS, METADATA}
_DATA_END = 0x0F
_KNOWN = range(0x01, 0x10)
_FOOTER_SIZE = 20
_HEAD = Struct("<BQ")
_MESSAGE = Struct("<HIQQ")
_CHUNK = Struct("<QQQI")
_LONG, _SHORT, _ID = Struct("<Q"), Struct("<I"), Struct("<H")
_LONGEST_NAME, _LONGEST_TEXT = 256, 0x10000
_MOST_METADATA = 100  # entries
_CONTRADICTIONS = "records with contradictions were left out"
_DAMAGED = "damaged chunks were left out"
_NO_RECORDS = "bytes outside of records were left out"


class Message(NamedTuple):
    """Message as stored in the file."""

    topic: str
    encoding: str
    time: int
    """Time in nanoseconds since 1970."""
    data: bytes


class Metadata(NamedTuple):
    """Names and texts written into the file by any program."""

    name: str
    texts: dict[str, str]


class McapReader:
    """Messages and metadata of a file, in the order of the file."""

    def __init__(self, path: Path) -> None:
        """Open the file at `path`. Raise RecordingError if unreadable or not an MCAP file."""
        self.path = path
        self.remarks: Counter[str] = Counter()
        """Number of omissions by kind; complete after the last record."""
        self.is_cut = False
        """Whether the file ends too early: the writer was killed, or the disk was full."""
        self._channels: dict[int, tuple[str, str]] = {}
        self._messages = 0  # number of messages read so far
        self._has_ended = False  # only an index follows: a message there is a damaged record of another kind
        self._counted: int | None = None  # number of messages stated in the file
        self._sure = len(MAGIC)  # start of the search if no record is at the expected place
        self._read_again = 0  # bytes
        try:
            self._file = open_file(path)
        except (OSError, ValueError) as error:
            raise RecordingError(f"cannot read the recording {path}: {reason(error)}") from error
        if self._take(len(MAGIC)) != MAGIC:
            self.close()
            raise RecordingError(f"{path} is not an MCAP file; `servolink record` writes one")

    def close(self) -> None:
        """Close the file of the recording."""
        self._file.close()

    def records(self) -> Iterator[Message | Metadata]:
        """Yield all readable records, once, and close the file. Raise RecordingError for a broken disk."""
        with self._file:
            while (record := self._next()) is not None:
                yield from self._understood(*record)

    def _next(self) -> tuple[int, bytes] | None:
        """Return kind and content of the next needed record; None at the end of the file."""
        while True:
            start = self._file.tell()
            head = self._take(_HEAD.size)
            kind, size = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
            if kind == FOOTER and size == _FOOTER_SIZE:
                if self._take(size + len(MAGIC))[size:] == MAGIC:
                    self._compare()
                    return None
            elif kind not in {0, FOOTER} and size <= self._left():
                self._sure = start + 1
                if kind in _READ and size <= LARGEST:
                    return kind, self._take(size)
                if kind in _READ:
                    self.remarks[f"records larger than {LARGEST // MIB} MiB were left out"] += 1
                elif kind == _DATA_END:
                    self._has_ended = True
                elif kind not in _KNOWN:
                    self.remarks["records of unknown kinds were left out"] += 1
                self._file.seek(size, 1)
                continue
            if not self._go_on(start):
                return None

    def _go_on(self, start: int) -> bool:
        """Go to the next record, if there is none at `start`. Return whether a record was found.

        The length of the previous record may be wrong, so the search begins inside. All such searches together read at
        most the whole file again: a hostile file must not have the same bytes read again and again.
        """
        self._read_again += start - self._sure
        end = self._end()
        begin = self._sure if self._read_again <= end else start + 1
        self._file.seek(begin)
        found = find_record(self._take, begin, end)
        if found is None:
            self.is_cut = True
            self.remarks += Counter({_NO_RECORDS: end - start})
            return False
        self.remarks[_NO_RECORDS] += found - min(begin, start)  # 0 for a wrong length without lost bytes
        self._file.seek(found)
        return True

    def _compare(self) -> None:
        """Add remarks on bytes behind the end of the file, and on messages counted in the file but not read."""
        self.remarks += Counter({"bytes behind the end of the recording were left out": self._left()})
        missing = 0 if self._counted is None else self._counted - self._messages
        self.remarks += Counter({"messages are missing, by the count at the end of the file": missing})
        self.remarks += Counter({"messages are too many, by the count at the end of the file": -missing})

    def _left(self) -> int:
        return self._end() - self._file.tell()

    def _end(self) -> int:
        return os.fstat(self._file.fileno()).st_size

    def _take(self, size: int) -> bytes:
        try:
            parts = bytearray()
            while len(parts) < size and (part := self._file.read(min(size - len(parts), MIB))):
                parts += part  # a false length costs no memory: only bytes present are read
            return bytes(parts)
        except OSError as error:
            raise RecordingError(f"cannot read the recording {self.path}: {reason(error)}") from error

    def _understood(self, kind: int, content: bytes) -> Iterator[Message | Metadata]:
        if kind == MESSAGE and self._has_ended:
            self.remarks[_CONTRADICTIONS] += 1
            return
        if kind != CHUNK:
            yield from self._one(kind, memoryview(content))
            return
        try:
            data = memoryview(self._decompressed(content))
        except UnusableChunk as error:
            self.remarks[str(error)] += 1
            return
        except (struct.error, ValueError):
            self.remarks[_DAMAGED] += 1
            return
        at = 0
        while at + _HEAD.size <= len(data):
            kind, size = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            if kind in _IN_CHUNKS:
                yield from self._one(kind, data[at : at + size])
            at += size

    def _one(self, kind: int, content: memoryview) -> Iterator[Message | Metadata]:
        """Yield a message or metadata, or keep a channel."""
        try:
            if kind == CHANNEL:
                self._keep_channel(_Fields(content))
            elif kind == METADATA:
                yield _metadata(_Fields(content))
            elif kind == STATISTICS:
                self._counted = _Fields(content).take(_LONG)
            else:
                channel, _, time, _ = _MESSAGE.unpack_from(content)
                message = Message(*self._channels[channel], time, bytes(content[_MESSAGE.size :]))
                self._messages += 1
                yield message
        except KeyError:
            self.remarks["messages of unknown channels were left out"] += 1
        except (struct.error, ValueError):
            self.remarks[_CONTRADICTIONS] += 1

    def _keep_channel(self, fields: _Fields) -> None:
        number, _ = fields.take(_ID), fields.take(_ID)
        topic, encoding = fields.text(_LONGEST_NAME), fields.text(_LONGEST_NAME)
        self._channels[number] = topic, encoding

    def _decompressed(self, content: bytes) -> bytes:
        """Return the records in a chunk. Raise UnusableChunk, struct.error or ValueError for a damaged chunk."""
        _, _, size, crc = _CHUNK.unpack_from(content)
        fields = _Fields(memoryview(content), _CHUNK.size)
        compression = fields.text(_LONGEST_NAME)
        packed = fields.raw(fields.take(_LONG))
        self._sure += _HEAD.size - 1 + fields.at  # the inner lengths agree, so the next record is behind the chunk
        try:
            data = decompress(compression, packed, size)
        except ImportError as error:
            raise RecordingError(
                f"{self.path} is compressed with {compression}, and the library for {compression} is missing; "
                f"{install_extra('record')}"
            ) from error
        if len(data) != size or (crc and zlib.crc32(data) != crc):
            raise UnusableChunk(_DAMAGED)
        return data


class UnusableChunk(Exception):
    """Unusable chunk; the text of the error is the remark."""


class _Fields:
    """Reads consecutive fields of a record. Raise ValueError or struct.error past the end."""

    def __init__(self, content: memoryview, at: int = 0) -> None:
        self.at = at
        self._content = content

    def take(self, number: Struct) -> int:
        (value,) = number.unpack_from(self._content, self.at)
        self.at += number.size
        return int(value)

    def raw(self, size: int) -> bytes:
        if size > len(self._content) - self.at:
            raise ValueError("a field ends behind the record")
        self.at += size
        return bytes(self._content[self.at - size : self.at])

    def text(self, longest: int) -> str:
        if (size := self.take(_SHORT)) > longest:
            raise ValueError("a text is too long")
        return self.raw(size).decode()


def _metadata(fields: _Fields) -> Metadata:
    name = fields.text(_LONGEST_NAME)
    end = fields.take(_SHORT) + fields.at
    texts: dict[str, str] = {}
    while fields.at < end and len(texts) < _MOST_METADATA:
        name_of_text = fields.text(_LONGEST_NAME)
        texts[name_of_text] = fields.text(_LONGEST_TEXT)
    return Metadata(name, texts)


def decompress(compression: str, packed: bytes, size: int) -> bytes:
    """Return at most `size` + 1 bytes. Raise UnusableChunk for a size beyond LARGEST, or data of another kind."""
    if size > LARGEST:
        raise UnusableChunk(f"chunks larger than {LARGEST // MIB} MiB were left out")
    if compression == "zstd":
        return _zstd(packed, size)
    if compression == "lz4":
        return _lz4(packed, size)
    if compression:
        raise UnusableChunk(f"chunks compressed with {quote(compression)} were left out")
    return packed


def _zstd(packed: bytes, size: int) -> bytes:
    import zstandard

    # As a stream: the size in the header of a frame may be a lie, and would be allocated at once.
    try:
        with zstandard.ZstdDecompressor(max_window_size=LARGEST).stream_reader(BytesIO(packed)) as stream:
            return stream.read(size + 1)
    except zstandard.ZstdError as error:
        raise UnusableChunk(_DAMAGED) from error


def _lz4(packed: bytes, size: int) -> bytes:
    import lz4.frame

    decompressor: Any = lz4.frame.LZ4FrameDecompressor()
    try:
        return bytes(decompressor.decompress(packed, max_length=size + 1))
    except (RuntimeError, EOFError) as error:
        raise UnusableChunk(_DAMAGED) from error


# --- behind a damaged record, whose length cannot be trusted ----------------------------------------------------------

_CHUNK_FIXED = 40  # bytes in a chunk besides the name of the compression and the records
_CHUNK_BYTES = re.compile(
    rb"\x06(?P<size>...[\x00\x01]\x00{4}).{28}(?P<compression>\x04\x00{3}zstd|\x03\x00{3}lz4|\x00{4})(?P<packed>.{8})",
    re.DOTALL,
)
_CHANNEL_BYTES = re.compile(rb"\x04(?P<size>..\x00{6}).{4}[^\x00]\x00{3}/[a-z]{1,32}\x04\x00{3}json", re.DOTALL)
_LONGEST: Final = 64
"""Maximum length of a match in bytes."""
_FIRST, _MOST = 512, MIB  # bytes read for each look: few at first, as the next record is mostly near


def find_record(read: Callable[[int], bytes], start: int, end: int) -> int | None:
    """Return the position of the next chunk or channel, None without any.

    `read` returns up to so many of the next bytes, starting at `start`; the file ends at `end`. The lengths of a found
    record agree with each other and with the end of the file, unlike in noise and compressed data.
    """
    window, amount = b"", _FIRST
    while part := read(amount):
        window += part
        found = [
            place for kind in (_CHUNK_BYTES, _CHANNEL_BYTES) if (place := _first(kind, window, end - start)) is not None
        ]
        if found:
            return start + min(found)
        rest = window[-_LONGEST:]  # may be the beginning of a match
        start += len(window) - len(rest)
        window, amount = rest, min(2 * amount, _MOST)
    return None


def _first(kind: re.Pattern[bytes], window: bytes, left: int) -> int | None:
    """Return the place of the first record of a kind in `window`, with `left` bytes behind its beginning."""
    found = kind.search(window)
    while found is not None:
        size = int.from_bytes(found["size"], "little")
        if found.start() + _HEAD.size + size <= left and (kind is _CHANNEL_BYTES or _agrees(found, size)):
            return found.start()
        found = kind.search(window, found.start() + 1)
    return None


def _agrees(chunk: re.Match[bytes], size: int) -> bool:
    return size == _CHUNK_FIXED + len(chunk["compression"]) - 4 + int.from_bytes(chunk["packed"], "little")
