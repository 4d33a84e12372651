"""LenientParser: what stands behind the documented content is dropped, and everything else is as usual."""

from __future__ import annotations

from servolink.protocol.codec import Codec
from servolink.protocol.editing import QueryProjectIDRequest, QueryProjectIDResponse
from servolink.protocol.frame import ByteOrder, encode_frame
from servolink.protocol.lenient import LenientParser
from servolink.protocol.packet import Packet
from servolink.protocol.parser import FrameParser
from servolink.protocol.servos import QueryServoListResponse
from servolink.protocol.settings import QueryMemorySizeResponse, SendDummyDataRequest
from tests.tables import over

PACKETS: tuple[Packet, ...] = (
    QueryProjectIDResponse(7),
    QueryServoListResponse((1, 2, 3)),
    QueryServoListResponse(),
    QueryMemorySizeResponse(5, 64),
    QueryMemorySizeResponse(5),
)


@over("byte_order", ["little", "big"])
@over("extra", [b"", b"\x09", b"\x13\x4c\x05\x1d" * 3])
@over("packet", PACKETS)
def test_longer_responses_are_those_of_the_document(packet: Packet, extra: bytes, byte_order: ByteOrder) -> None:
    if packet == QueryMemorySizeResponse(5) and len(extra) >= 4:
        return  # that is a total size
    codec, parser = Codec(byte_order), LenientParser(byte_order)
    content = codec.encode(packet)[8:-1]
    longer = encode_frame(packet.packet_id, content + extra, byte_order)
    data = longer + codec.encode(QueryProjectIDResponse(1))
    frames = [frame for byte in data for frame in parser.feed(bytes([byte]))]
    assert [codec.decode(*frame) for frame in frames] == [packet, QueryProjectIDResponse(1)]
    assert sum(parser.skipped.values()) == 0
    if extra:
        assert (packet.packet_id, content) not in FrameParser(byte_order).feed(data)


def test_requests_and_damaged_lengths_are_as_strict_as_ever() -> None:
    parser = LenientParser()
    assert parser.feed(encode_frame(QueryProjectIDRequest.packet_id, b"\0", "little") + bytes(9)) == []
    assert parser.feed(encode_frame(QueryProjectIDResponse.packet_id, bytes(4 + 256), "little") + bytes(9)) == []
    assert parser.feed(encode_frame(QueryProjectIDResponse.packet_id, bytes(3), "little") + bytes(9)) == []
    dummy = encode_frame(SendDummyDataRequest.packet_id, b"abc", "little")
    assert parser.feed(dummy) == [(SendDummyDataRequest.packet_id, b"abc")]


def test_a_frame_that_is_abandoned_returns_those_inside() -> None:
    codec, parser = Codec(), LenientParser()
    inside = encode_frame(
        QueryProjectIDResponse.packet_id, codec.encode(QueryProjectIDResponse(7))[8:-1] + b"!", "little"
    )
    assert parser.feed(encode_frame(QueryServoListResponse.packet_id, bytes(60), "little")[:-40] + inside) == []
    assert [codec.decode(*frame) for frame in parser.abandon_frame()] == [QueryProjectIDResponse(7)]
