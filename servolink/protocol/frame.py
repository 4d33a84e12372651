"""Frames: magic, packet id, content length, content, checksum (document, chapter 1)."""

from __future__ import annotations

from functools import lru_cache
from struct import Struct
from typing import Literal, NamedTuple
from zlib import adler32

_MOST_BLOCKS = 4096  # running sums kept: enough for 1 MiB of stream


@lru_cache(maxsize=256)
def piecewise(size: int) -> Struct:
    """Return the struct to cut `size` bytes into pieces of 256."""
    whole, rest = divmod(size, 256)
    return Struct("256s" * whole + (f"{rest}s" if rest else ""))


class BlockSums:
    """Sums of long spans of a moving buffer, from running sums of blocks of 256 bytes, each computed once.

    Without running sums, headers with overlapping contents would make the parser sum the same bytes again and again.
    """

    def __init__(self) -> None:
        """Start at the beginning of a stream."""
        self._origin = 0  # stream offset of the buffer's first byte
        self._first = 0  # block where the running sums begin
        self._running = [0]

    def move(self, by: int) -> None:
        """Record that the start of the buffer moved by `by` bytes in the stream."""
        self._origin += by

    def sum(self, data: bytes, start: int, end: int) -> int:
        """Return the sum of `data[start:end]`, correct in the low 8 bits."""
        first = -(-(self._origin + start) // 256)
        last = (self._origin + end) // 256
        head = adler32(data[start : first * 256 - self._origin]) - 1
        tail = adler32(data[last * 256 - self._origin : end]) - 1
        return head + self._blocks(data, first, last) + tail

    def _blocks(self, data: bytes, first: int, last: int) -> int:
        running = self._running
        if not 0 <= first - self._first < len(running) or len(running) > _MOST_BLOCKS:
            running = self._running = [0]
            self._first = first
        for block in range(self._first + len(running) - 1, last):
            offset = block * 256 - self._origin
            running.append(running[-1] + adler32(data[offset : offset + 256]) - 1)
        return running[last - self._first] - running[first - self._first]


ByteOrder = Literal["little", "big"]
Frame = tuple[int, bytes]
"""Packet id and content of an intact frame."""

MAGIC = b"\x13\x4c\x05\x1d"
HEADER_SIZE = 8
OVERHEAD = HEADER_SIZE + 1
"""Bytes of a frame besides the content: header and checksum."""
MAX_CONTENT = 0xFFFF

HEADER = {"little": Struct("<4sHH"), "big": Struct(">4sHH")}


def checksum(data: bytes) -> int:
    """Return the sum of all bytes modulo 256 (document, 1.3).

    The low half of an Adler-32 is the sum of the bytes plus 1, exact up to 256 bytes and eight times as fast as
    `sum`. The high half is a multiple of 65,536 and falls away.
    """
    if len(data) <= 256:
        return (adler32(data) - 1) & 0xFF
    pieces = piecewise(len(data)).unpack(data)
    return (sum(map(adler32, pieces)) - len(pieces)) & 0xFF


class FrameAt(NamedTuple):
    """Frame announced by a header in a stream."""

    packet_id: int
    size: int
    """Bytes of the whole frame."""
    data: bytes
    """Bytes of the frame that are there: fewer than `size` at the end of the stream."""

    @classmethod
    def read(cls, stream: bytes, at: int, byte_order: ByteOrder) -> FrameAt | None:
        """Return the frame that begins at `at`; None without a whole header there. The magic is not checked."""
        if len(stream) - at < HEADER_SIZE:
            return None
        _, packet_id, length = HEADER[byte_order].unpack_from(stream, at)
        size = length + OVERHEAD
        return cls(packet_id, size, stream[at : at + size])

    @property
    def length(self) -> int:
        """Announced bytes of the content."""
        return self.size - OVERHEAD

    @property
    def content(self) -> bytes:
        """Content of a whole frame."""
        return self.data[HEADER_SIZE:-1]

    @property
    def is_whole(self) -> bool:
        """Whether all bytes are there."""
        return len(self.data) == self.size

    @property
    def is_intact(self) -> bool:
        """Whether all bytes are there, and their sum is right."""
        return self.is_whole and checksum(self.data[:-1]) == self.data[-1]


def encode_frame(packet_id: int, content: bytes, byte_order: ByteOrder) -> bytes:
    """Return the frame for `content` of at most 65,535 bytes."""
    frame = HEADER[byte_order].pack(MAGIC, packet_id, len(content)) + content
    return frame + _BYTES[(adler32(frame) - 1) & 0xFF if len(frame) <= 256 else checksum(frame)]


_BYTES = [bytes((number,)) for number in range(256)]
