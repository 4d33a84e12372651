"""The wire of a recording as a capture for Wireshark: pcapng with a packet for each frame.

A frame becomes a packet, for any chunks on the line, because Wireshark shows a line, a time and a response time
for each packet. The chunks stay in the recording. Bytes outside of frames are captured as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from struct import Struct
from typing import BinaryIO, Final, NamedTuple

from servolink.errors import escape
from servolink.protocol import ByteOrder, Frame, FrameParser, encode_frame
from servolink.recorder.channels import Direction, Recorded, Wire
from servolink.recorder.new_file import new_file

LINKTYPE_USER0: Final = 147
"""Link type of captures without a registered type; the dissector of `servolink wireshark` reads such captures."""

_SECTION, _INTERFACE, _PACKET = 0x0A0D0D0A, 1, 6  # types of blocks
_COMMENT, _APPLICATION, _NAME, _RESOLUTION, _FLAGS = 1, 4, 2, 9, 2  # options of blocks
_NANOSECONDS = b"\x09"
_IN, _OUT = 1, 2  # direction as seen by the host
_BLOCK, _OPTION, _PACKET_HEAD = Struct("<II"), Struct("<HH"), Struct("<IIIII")
_SECTION_HEAD, _INTERFACE_HEAD = Struct("<IHHq"), Struct("<HHI")
_MOST_TEXT = 400  # bytes of a board's name, taken from the recording
_MOST_NOISE = 0x10000
_PAUSE = 100_000_000  # nanoseconds after which noise is not continued


class Captured(NamedTuple):
    """Packet of a capture: a frame, or bytes between frames."""

    nanoseconds: int
    """Time of the last byte, in nanoseconds since 1970."""
    direction: Direction
    data: bytes


def write_pcapng(file: BinaryIO, wire: Iterable[tuple[int, Wire]], recorded: Recorded) -> int:
    """Write a capture of `wire`, chunks with their times in nanoseconds since 1970; return the number of packets.

    The byte order of `recorded` decides where frames begin and end.
    """
    order: ByteOrder = "big" if recorded.byte_order == "big" else "little"
    return write_packets(file, captured(wire, order), comment=_comment(recorded, order))


def save_pcapng(path: Path, wire: Iterable[tuple[int, Wire]], recorded: Recorded, *, replace: bool = False) -> int:
    """Write a capture to a file, as by `write_pcapng`.

    Raise RecordingError, without any change, if the file exists and `replace` is not set, or cannot be written.
    """
    with new_file(path, replace=replace) as file:
        return write_pcapng(file, wire, recorded)


def write_packets(file: BinaryIO, packets: Iterable[Captured], *, comment: str, link_type: int = LINKTYPE_USER0) -> int:
    """Write a capture of `packets`, with a comment for people, and return their number."""
    file.write(_section(comment) + _interface(link_type))
    count = 0
    for packet in packets:
        file.write(_packet(packet))
        count += 1
    return count


def captured(wire: Iterable[tuple[int, Wire]], byte_order: ByteOrder) -> Iterator[Captured]:
    """Yield the frames of both directions, and the bytes between, in the order of their ends."""
    sent, received = _Cutter("sent", byte_order), _Cutter("received", byte_order)
    for nanoseconds, chunk in wire:
        own, other = (sent, received) if chunk.direction == "sent" else (received, sent)
        for packet in own.feed(nanoseconds, chunk.data):
            yield from other.flush()
            yield packet
    yield from sorted([*sent.finish(), *received.finish()], key=lambda packet: packet.nanoseconds)


class _Cutter:
    """Cuts a direction into frames and noise."""

    def __init__(self, direction: Direction, byte_order: ByteOrder) -> None:
        self._direction: Direction = direction
        self._byte_order: ByteOrder = byte_order
        self._parser = FrameParser(byte_order, keep_skipped=True)
        self._now = 0  # time of the last chunk
        self._noise = b""  # not captured yet, as more noise may follow
        self._noise_at = 0

    def feed(self, nanoseconds: int, data: bytes) -> Iterator[Captured]:
        if nanoseconds - self._noise_at > _PAUSE:
            yield from self.flush()
        self._now = nanoseconds
        yield from self._cut(self._parser.feed(data))

    def finish(self) -> Iterator[Captured]:
        yield from self._cut(self._parser.finish())
        yield from self.flush()

    def flush(self) -> Iterator[Captured]:
        noise, self._noise = self._noise, b""
        for at in range(0, len(noise), _MOST_NOISE):
            yield Captured(self._noise_at, self._direction, noise[at : at + _MOST_NOISE])

    def _cut(self, frames: list[Frame]) -> Iterator[Captured]:
        """Yield `frames`, and the bytes skipped before each."""
        skipped = self._parser.take_skipped()
        for at, (packet_id, content) in enumerate(frames):
            while skipped and skipped[0][0] <= at:
                yield from self._add_noise(skipped.pop(0)[1])
            yield from self.flush()
            yield Captured(self._now, self._direction, encode_frame(packet_id, content, self._byte_order))
        for _, noise, _ in skipped:
            yield from self._add_noise(noise)

    def _add_noise(self, data: bytes) -> Iterator[Captured]:
        self._noise += data
        self._noise_at = self._now
        if len(self._noise) >= _MOST_NOISE:
            yield from self.flush()


def _comment(recorded: Recorded, byte_order: ByteOrder) -> str:
    board, encoding, started = map(_short, (recorded.board, recorded.caption_encoding, recorded.started))
    return f"servo control board {board}, byte order {byte_order}, captions in {encoding}, from {started}"


def _section(comment: str) -> bytes:
    head = _SECTION_HEAD.pack(0x1A2B3C4D, 1, 0, -1)
    return _block(_SECTION, head + _options((_COMMENT, comment.encode()), (_APPLICATION, b"servolink")))


def _interface(link_type: int) -> bytes:
    head = _INTERFACE_HEAD.pack(link_type, 0, 0)
    return _block(_INTERFACE, head + _options((_NAME, b"servo control board"), (_RESOLUTION, _NANOSECONDS)))


def _packet(packet: Captured) -> bytes:
    high, low = divmod(packet.nanoseconds, 1 << 32)
    size = len(packet.data)
    flags = (_OUT if packet.direction == "sent" else _IN).to_bytes(4, "little")
    head = _PACKET_HEAD.pack(0, high & 0xFFFF_FFFF, low, size, size)
    return _block(_PACKET, head + _padded(packet.data) + _options((_FLAGS, flags)))


def _block(kind: int, body: bytes) -> bytes:
    size = len(body) + 12
    return _BLOCK.pack(kind, size) + body + size.to_bytes(4, "little")


def _options(*options: tuple[int, bytes]) -> bytes:
    return b"".join(_OPTION.pack(code, len(value)) + _padded(value) for code, value in options) + bytes(4)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)


def _short(text: str) -> str:
    return escape(text)[:_MOST_TEXT]
