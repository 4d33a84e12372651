"""Frames: layout, checksum, and the fast sum that the parser uses."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.protocol.frame import (
    HEADER_SIZE,
    MAGIC,
    OVERHEAD,
    ByteOrder,
    checksum,
    encode_frame,
    piecewise,
)
from tests.tables import over


@pytest.mark.parametrize(
    ("byte_order", "expected"),
    [("little", "134c051d 1a27 0100 01 c4"), ("big", "134c051d 271a 0001 01 c4")],
)
def test_a_frame_is_magic_id_length_content_and_sum(byte_order: ByteOrder, expected: str) -> None:
    assert encode_frame(10010, b"\x01", byte_order) == bytes.fromhex(expected)


@given(st.integers(0, 0xFFFF), st.binary(max_size=700), st.sampled_from(["little", "big"]))
def test_every_frame_is_nine_bytes_longer_than_its_content_and_ends_with_the_sum(
    packet_id: int, content: bytes, byte_order: ByteOrder
) -> None:
    frame = encode_frame(packet_id, content, byte_order)
    assert len(frame) == len(content) + OVERHEAD
    assert frame.startswith(MAGIC)
    assert int.from_bytes(frame[4:6], byte_order) == packet_id
    assert int.from_bytes(frame[6:8], byte_order) == len(content)
    assert frame[HEADER_SIZE:-1] == content
    assert frame[-1] == sum(frame[:-1]) % 256


def test_the_checksum_wraps_at_256() -> None:
    assert checksum(b"") == 0
    assert checksum(b"\xff\x01") == 0
    assert checksum(b"\xff" * 1000) == 1000 * 255 % 256


@over("size", [0, 1, 255, 256, 257, 511, 512, 513, 4096, 65535])
@over("byte", [0x00, 0x01, 0x7F, 0xFF])
def test_the_fast_sum_is_exact_at_every_border(size: int, byte: int) -> None:
    content = bytes([byte]) * size
    assert checksum(content) == sum(content) & 0xFF


@given(st.binary(max_size=2000))
def test_the_fast_sum_is_the_sum(content: bytes) -> None:
    assert checksum(content) == sum(content) & 0xFF


def test_content_is_cut_into_pieces_that_are_summed_exactly() -> None:
    assert [len(piece) for piece in piecewise(256).unpack(bytes(256))] == [256]
    assert [len(piece) for piece in piecewise(600).unpack(bytes(600))] == [256, 256, 88]
