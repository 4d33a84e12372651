"""Packets to frames and back, for one board's byte order and caption encoding."""

from __future__ import annotations

import msgspec

from servolink.errors import DecodeError
from servolink.protocol import editing, joystick, servos, settings
from servolink.protocol.caption import check_encoding
from servolink.protocol.frame import HEADER, HEADER_SIZE, MAGIC, OVERHEAD, ByteOrder, checksum, encode_frame
from servolink.protocol.layout import Decoder, layout
from servolink.protocol.packet import Packet, Request, Response

PACKETS: dict[int, type[Packet]] = {
    declared.packet_id: declared
    for chapter in (settings, servos, editing, joystick)
    for declared in vars(chapter).values()
    if isinstance(declared, type) and issubclass(declared, Packet) and hasattr(declared, "packet_id")
}
"""Every packet class of the document, by packet id."""

PACKETS_BY_NAME: dict[str, type[Packet]] = {declared.__name__: declared for declared in PACKETS.values()}
"""Every packet class of the document, by its name there."""


def response_class(request: Request[Response]) -> type[Packet]:
    """Return the class of the answer to `request`: the packet whose id is one higher."""
    return PACKETS[request.packet_id + 1]


class Codec:
    """Byte order and caption encoding, the two things the document leaves open, applied to packets."""

    def __init__(self, byte_order: ByteOrder = "little", caption_encoding: str = "utf-8") -> None:
        """Raise ValueError for a byte order or an encoding that does not exist."""
        if byte_order not in HEADER:
            raise ValueError(f"byte order {byte_order!r} is neither 'little' nor 'big'")
        self.byte_order: ByteOrder = byte_order
        self.caption_encoding = check_encoding(caption_encoding)
        self._decoders: dict[int, Decoder] = {}  # filled as packets come

    def encode(self, packet: Packet, *, unchecked: bool = False) -> bytes:
        """Return the frame of `packet`; EncodeError names packet, field, value and range.

        `unchecked` is for giving back to a board what was read from one: captions may then hold control characters,
        numbers all that the wire carries.
        """
        content = layout(type(packet), self.byte_order).encode(packet, self.caption_encoding, unchecked=unchecked)
        return encode_frame(packet.packet_id, content, self.byte_order)

    def decode(self, packet_id: int, content: bytes) -> Packet:
        """Return the packet in `content`; DecodeError, with the content, if it is none."""
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
        """Return the packet of exactly one frame; DecodeError, with the bytes, says what is wrong with it."""
        if len(data) < OVERHEAD:
            raise DecodeError(f"{len(data)} bytes are less than the {OVERHEAD} of the shortest frame", data)
        magic, packet_id, length = HEADER[self.byte_order].unpack_from(data)
        if magic != MAGIC:
            raise DecodeError(f"starts with {magic.hex(' ')}, not with the magic {MAGIC.hex(' ')}", data)
        if len(data) != length + OVERHEAD:
            raise DecodeError(f"the header announces {length + OVERHEAD} bytes in all, here are {len(data)}", data)
        if (expected := checksum(data[:-1])) != data[-1]:
            raise DecodeError(f"the checksum is {data[-1]:#04x}, the bytes sum to {expected:#04x}", data)
        try:
            return self.decode(packet_id, data[HEADER_SIZE:-1])
        except DecodeError as error:
            raise DecodeError(str(error), data) from None


def in_range(packet: Packet) -> bool:
    """Tell whether all values of `packet` are allowed by its declaration; decoding lets everything pass."""
    try:
        msgspec.convert(msgspec.to_builtins(packet), type(packet))
    except msgspec.ValidationError:
        return False
    return True
