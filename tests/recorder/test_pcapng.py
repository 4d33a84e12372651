"""Captures for Wireshark: nothing is lost, and each frame is a packet with its time and direction."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from struct import unpack_from
from typing import NamedTuple

from hypothesis import given
from hypothesis import strategies as st

from servolink.protocol import (
    ByteOrder,
    Codec,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    encode_frame,
)
from servolink.recorder.channels import Direction, Recorded, Wire
from servolink.recorder.pcapng import LINKTYPE_USER0, Captured, captured, write_pcapng
from tests.protocol.declared import any_packet

RECORDED = Recorded("1.2.3", "2026-01-02T03:04:05Z", "rex", "board")
START = 1_767_323_045_123_456_789  # nanoseconds since 1970


class Block(NamedTuple):
    """A block of a file, with its options."""

    kind: int
    body: bytes
    options: dict[int, bytes]


def blocks(data: bytes) -> Iterator[Block]:
    """Read a file as its format describes it."""
    at = 0
    while at < len(data):
        kind, size = unpack_from("<II", data, at)
        assert size % 4 == 0
        assert unpack_from("<I", data, at + size - 4) == (size,)
        body = data[at + 8 : at + size - 4]
        fixed = {0x0A0D0D0A: 16, 1: 8}.get(kind)
        if fixed is None:
            length = unpack_from("<I", body, 12)[0]
            fixed = 20 + length + -length % 4
        yield Block(kind, body, dict(options(body[fixed:])))
        at += size


def options(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while (head := unpack_from("<HH", data, at)) != (0, 0):
        yield head[0], data[at + 4 : at + 4 + head[1]]
        at += 4 + head[1] + -head[1] % 4
    assert at + 4 == len(data)


def read_back(data: bytes) -> list[Captured]:
    """Return the packets of a file."""
    found = []
    for block in [*blocks(data)][2:]:
        interface, high, low, size, original = unpack_from("<IIIII", block.body)
        assert (block.kind, interface, size) == (6, 0, original)
        direction: Direction = "received" if block.options[2] == b"\1\0\0\0" else "sent"
        assert block.options == {2: b"\1\0\0\0" if direction == "received" else b"\2\0\0\0"}
        found.append(Captured(high << 32 | low, direction, block.body[20 : 20 + size]))
    return found


def wire(*chunks: tuple[int, Direction, bytes]) -> list[tuple[int, Wire]]:
    """Return chunks with their times in milliseconds."""
    return [(START + ms * 1_000_000, Wire(direction, data, ms / 1000)) for ms, direction, data in chunks]


def test_each_frame_is_a_packet() -> None:
    codec = Codec()
    asked, said = codec.encode(QueryServoListRequest()), codec.encode(QueryServoListResponse((1, 2)))
    chunks = wire((0, "sent", asked + asked), (1, "received", said[:5]), (3, "received", said[5:] + b"noise" + said))
    file = BytesIO()
    assert write_pcapng(file, chunks, RECORDED) == 5
    assert read_back(file.getvalue()) == [
        Captured(START, "sent", asked),
        Captured(START, "sent", asked),
        Captured(START + 3_000_000, "received", said),
        Captured(START + 3_000_000, "received", b"noise"),
        Captured(START + 3_000_000, "received", said),
    ]


def test_the_head_says_what_is_in_it() -> None:
    file = BytesIO()
    recorded = Recorded("1", "2026\x1b[2J", "rex\u202e" + "x" * 70_000, "board", "big", "big5")
    assert write_pcapng(file, [], recorded) == 0
    section, interface = blocks(file.getvalue())
    assert unpack_from("<IHHq", section.body) == (0x1A2B3C4D, 1, 0, -1)
    assert unpack_from("<HHI", interface.body) == (LINKTYPE_USER0, 0, 0)
    assert interface.options[9] == b"\x09"
    comment = section.options[1].decode()
    assert comment.startswith("servo control board rex\\u202exxx")
    assert comment.endswith("x, byte order big, captions in big5, from 2026\\x1b[2J")


def test_noise_keeps_its_time_and_its_place() -> None:
    asked = Codec().encode(QueryServoRequest(3))
    unknown = encode_frame(50_000, b"new", "little")
    chunks = wire(
        (0, "received", b"begin"),
        (50, "received", b" and end"),
        (60, "sent", asked),
        (70, "received", unknown[:6]),
        (71, "received", unknown[6:]),
        (900, "received", b"later"),
        (901, "sent", asked[:4]),
    )
    assert [*captured(chunks, "little")] == [
        Captured(START + 50_000_000, "received", b"begin and end"),
        Captured(START + 60_000_000, "sent", asked),
        Captured(START + 71_000_000, "received", unknown),
        Captured(START + 900_000_000, "received", b"later"),
        Captured(START + 901_000_000, "sent", asked[:4]),
    ]


@given(st.data(), st.sampled_from(("little", "big")))
def test_no_byte_is_lost(data: st.DataObject, order: ByteOrder) -> None:
    codec = Codec(order)
    frames = any_packet.map(lambda packet: codec.encode(packet, unchecked=True))
    part = frames | st.binary(max_size=30).filter(lambda noise: 0x13 not in noise)
    streams: dict[Direction, bytes] = {
        direction: b"".join(data.draw(st.lists(part, max_size=4))) for direction in ("sent", "received")
    }
    left, chunks, now = dict(streams), [], 0
    while any(left.values()):
        direction: Direction = data.draw(st.sampled_from([each for each in left if left[each]]))
        size, now = data.draw(st.integers(1, 200)), now + data.draw(st.sampled_from((0, 1, 200)))
        chunks += wire((now, direction, left[direction][:size]))
        left[direction] = left[direction][size:]
    found = [*captured(chunks, order)]
    for direction, stream in streams.items():
        assert b"".join(packet.data for packet in found if packet.direction == direction) == stream
    assert all(packet.data for packet in found)
