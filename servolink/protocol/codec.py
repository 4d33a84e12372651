"""Conversion of packets to frames and back, in the byte order and caption encoding of a board."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar, cast

from servolink.errors import DecodeError, quote
from servolink.protocol import editing, joystick, servos, settings
from servolink.protocol.caption import check_encoding
from servolink.protocol.frame import HEADER, HEADER_SIZE, MAGIC, OVERHEAD, ByteOrder, checksum, encode_frame
from servolink.protocol.layouts import Decoder, layout
from servolink.protocol.packet import Packet, Request, Result

R = TypeVar("R", bound=Result)


class PacketTable(dict[int, type[Packet]]):
    """Packet classes by packet id."""

    def __init__(self, declared: Iterable[type[Packet]]) -> None:
        """List the classes `declared`."""
        super().__init__({each.packet_id: each for each in declared})
        self.by_name = {each.__name__: each for each in self.values()}
        """Packet classes by name in the document."""

    def response_of(self, request: Request[Any]) -> type[Packet]:
        """Return the class of the response to `request`: the packet with the next higher id."""
        return self[request.packet_id + 1]

    def result_of(self, request: Request[R], *, done: bool) -> R:
        """Return the response to `request` that reports whether the request was done."""
        declared: Any = self.response_of(request)
        return cast("R", declared(int(done)))


PACKETS = PacketTable(
    declared
    for chapter in (settings, servos, editing, joystick)
    for declared in vars(chapter).values()
    if isinstance(declared, type) and issubclass(declared, Packet) and hasattr(declared, "packet_id")
)
"""All packet classes of the document."""

_MOST_QUERIES = 1024  # remembered frames: enough for all servos and the records of most boards


class Codec:
    """Encoder and decoder of packets in a byte order and a caption encoding, neither fixed by the document."""

    def __init__(self, byte_order: ByteOrder = "little", caption_encoding: str = "utf-8") -> None:
        """Raise ValueError for an unknown byte order or encoding."""
        if byte_order not in HEADER:
            raise ValueError(f"byte_order must be 'little' or 'big', not {quote(byte_order)}")
        self.byte_order: ByteOrder = byte_order
        self.caption_encoding = check_encoding(caption_encoding)
        self._decoders: dict[int, Decoder] = {}  # filled on use
        self._queries: dict[Packet, bytes] = {}  # frames of queries, as programs send the same ones again and again

    def __getstate__(self) -> dict[str, object]:
        """Return the state for a copy or another process: decoders cannot be pickled, and are created on use."""
        return {**vars(self), "_decoders": {}, "_queries": {}}

    def encode(self, packet: Packet, *, unchecked: bool = False) -> bytes:
        """Return the frame of `packet`. Raise EncodeError naming packet, field, value and range.

        `unchecked` is for writing back values read from a board: captions may then have control characters, and numbers
        may have any value in the range of the wire.
        """
        may_remember = packet.is_query and not unchecked
        if may_remember:
            try:
                return self._queries[packet]
            except (KeyError, TypeError):  # or a value without a hash, which is refused below
                pass
        content = layout(type(packet), self.byte_order).encode(packet, self.caption_encoding, unchecked=unchecked)
        frame = encode_frame(packet.packet_id, content, self.byte_order)
        if may_remember:
            if len(self._queries) >= _MOST_QUERIES:
                self._queries.clear()
            self._queries[packet] = frame
        return frame

    def decode(self, packet_id: int, content: bytes) -> Packet:
        """Return the packet in `content`. Raise DecodeError, with the content, for anything else."""
        try:
            decode = self._decoders[packet_id]
        except KeyError:
            decode = self._decoder(packet_id, content)
        return decode(content, self.caption_encoding)

    def _decoder(self, packet_id: int, content: bytes) -> Decoder:
        declared = PACKETS.get(packet_id)
        if declared is None:
            raise DecodeError(f"no packet has the id {packet_id}", content)
        decoder = self._decoders[packet_id] = layout(declared, self.byte_order).decode
        return decoder

    def decode_frame(self, data: bytes) -> Packet:
        """Return the packet in exactly one frame. Raise DecodeError, with the bytes, for a damaged frame."""
        if len(data) < OVERHEAD:
            raise DecodeError(f"{len(data)} bytes are fewer than the {OVERHEAD} of the shortest frame", data)
        magic, packet_id, length = HEADER[self.byte_order].unpack_from(data)
        if magic != MAGIC:
            raise DecodeError(f"the frame begins with {magic.hex(' ')}, not with the magic {MAGIC.hex(' ')}", data)
        if len(data) != length + OVERHEAD:
            raise DecodeError(f"the header announces {length + OVERHEAD} bytes in all, not {len(data)}", data)
        if (expected := checksum(data[:-1])) != data[-1]:
            raise DecodeError(f"the checksum is {data[-1]:#04x}, but the bytes sum to {expected:#04x}", data)
        try:
            return self.decode(packet_id, data[HEADER_SIZE:-1])
        except DecodeError as error:
            raise DecodeError(str(error), data) from None
