"""Frames: magic, packet id, content length, content, checksum (document, chapter 1)."""

from __future__ import annotations

from struct import Struct
from typing import Literal
from zlib import adler32

from servolink.protocol.sums import content_sum, piecewise

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
    if len(data) > 256:
        return content_sum(data, piecewise(len(data))) & 0xFF
    return (adler32(data) - 1) & 0xFF


def encode_frame(packet_id: int, content: bytes, byte_order: ByteOrder) -> bytes:
    """Return the whole frame for `content` of at most 65,535 bytes."""
    frame = HEADER[byte_order].pack(MAGIC, packet_id, len(content)) + content
    return frame + _BYTES[checksum(frame)]


_BYTES = [bytes((number,)) for number in range(256)]
