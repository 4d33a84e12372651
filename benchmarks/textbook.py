"""The parser that most projects have: one bytearray, `find`, `sum`, `del`. What ours is measured against."""

from __future__ import annotations

from servolink.protocol.frame import HEADER, HEADER_SIZE, MAGIC, OVERHEAD, ByteOrder, Frame


class TextbookParser:
    """Frames whose sum is right; a false start costs one byte, an unknown id or length is not noticed."""

    def __init__(self, byte_order: ByteOrder = "little") -> None:
        """Begin with an empty buffer."""
        self._buffer = bytearray()
        self._header = HEADER[byte_order]

    def feed(self, chunk: bytes) -> list[Frame]:
        """Take the next bytes of the stream and return the frames that are now complete."""
        buffer = self._buffer
        buffer += chunk
        frames: list[Frame] = []
        while True:
            start = buffer.find(MAGIC)
            if start < 0:
                del buffer[: max(0, len(buffer) - len(MAGIC) + 1)]
                return frames
            del buffer[:start]
            if len(buffer) < HEADER_SIZE:
                return frames
            _, packet_id, length = self._header.unpack_from(buffer)
            end = length + OVERHEAD
            if len(buffer) < end:
                return frames
            if sum(buffer[: end - 1]) & 0xFF == buffer[end - 1]:
                frames.append((packet_id, bytes(buffer[HEADER_SIZE : end - 1])))
                del buffer[:end]
            else:
                del buffer[:1]
