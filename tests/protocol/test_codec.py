"""Packets to frames and back: golden frames, any packet, and damaged frames."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import DecodeError, EncodeError
from servolink.protocol.codec import Codec
from servolink.protocol.editing import AddActionRequest, QueryActionRequest, QueryActionResponse, QueryMacroRequest
from servolink.protocol.frame import ByteOrder, encode_frame
from servolink.protocol.packet import Packet
from servolink.protocol.records import Step
from servolink.protocol.servos import ExecuteActionRequest, QueryServoRequest
from tests.protocol.declared import VECTORS, VECTORS_BY_NAME, any_packet, packet_of
from tests.tables import over

byte_orders: st.SearchStrategy[ByteOrder] = st.sampled_from(["little", "big"])


def test_there_are_golden_frames_of_every_packet_in_both_byte_orders() -> None:
    assert len(VECTORS) == 420
    assert len({(vector.packet_id, vector.byte_order) for vector in VECTORS}) == 120


@over("name", VECTORS_BY_NAME)
def test_golden_frames_are_written_and_read_exactly(name: str) -> None:
    for vector in VECTORS_BY_NAME[name]:
        codec, packet = Codec(vector.byte_order), packet_of(vector)
        assert codec.encode(packet) == vector.frame
        assert codec.decode_frame(vector.frame) == packet


@given(any_packet, byte_orders)
def test_every_packet_comes_back_as_it_was(packet: Packet, byte_order: ByteOrder) -> None:
    codec = Codec(byte_order)
    assert codec.decode_frame(codec.encode(packet)) == packet


@given(any_packet, byte_orders, st.data())
def test_a_flipped_bit_or_a_cut_is_never_read_as_the_packet(packet: Packet, byte_order: ByteOrder, data: Any) -> None:
    codec = Codec(byte_order)
    frame = codec.encode(packet)
    at, bit = data.draw(st.integers(0, len(frame) - 1)), data.draw(st.integers(0, 7))
    flipped = frame[:at] + bytes([frame[at] ^ 1 << bit]) + frame[at + 1 :]
    for damaged in (flipped, frame[:at], frame + b"\0"):
        with pytest.raises(DecodeError) as refused:
            codec.decode_frame(damaged)
        assert refused.value.data == damaged


@given(st.binary(max_size=80), st.sampled_from([20050, 20020, 30021, 10031, 10050, 40081, 12345]), byte_orders)
def test_any_content_is_a_packet_or_a_decode_error(content: bytes, packet_id: int, byte_order: ByteOrder) -> None:
    codec = Codec(byte_order)
    try:
        read: int | bytes = codec.decode(packet_id, content).packet_id
    except DecodeError as error:
        read = error.data
    assert read in (packet_id, content)


@pytest.mark.parametrize(
    ("frame", "fault"),
    [
        ("", "0 bytes are fewer than the 9 of the shortest frame"),
        ("134c051d 344e 0100", "8 bytes are fewer than the 9 of the shortest frame"),
        ("134c051e 344e 0100 07 0a", "the frame begins with 13 4c 05 1e, not with the magic 13 4c 05 1d"),
        ("134c051d 344e 0200 07 0a", "the header announces 11 bytes in all, not 10"),
        ("134c051d 344e 0100 07 0c", "the checksum is 0x0c, but the bytes sum to 0x0b"),
        ("134c051d 3930 0000 ea", "no packet has the id 12345"),
    ],
)
def test_what_is_wrong_with_a_frame_is_said(frame: str, fault: str) -> None:
    data = bytes.fromhex(frame)
    with pytest.raises(DecodeError) as refused:
        Codec().decode_frame(data)
    assert str(refused.value) == fault
    assert refused.value.data == data


def test_an_intact_frame_whose_content_lies_keeps_all_its_bytes() -> None:
    frame = encode_frame(ExecuteActionRequest.packet_id, b"\x02" + bytes(5), "little")
    with pytest.raises(DecodeError, match="2 steps take 11 bytes, the content has 6") as refused:
        Codec().decode_frame(frame)
    assert refused.value.data == frame


def test_byte_order_and_encoding_are_settings() -> None:
    assert Codec("big").encode(QueryServoRequest(7)) == bytes.fromhex("134c051d 4e34 0001 07 0b")
    packet = AddActionRequest(1, "揮手")
    big5, utf8 = Codec(caption_encoding="big5"), Codec()
    assert big5.decode_frame(big5.encode(packet)) == packet
    assert big5.encode(packet) != utf8.encode(packet)
    assert utf8.decode_frame(utf8.encode(packet)) == packet


@pytest.mark.parametrize(
    ("settings", "fault"),
    [
        ({"byte_order": "middle"}, "byte_order must be 'little' or 'big', not 'middle'"),
        ({"caption_encoding": "klingon"}, "caption encoding 'klingon' cannot be used"),
    ],
)
def test_a_setting_that_does_not_exist_is_refused(settings: dict[str, Any], fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        Codec(**settings)


def test_a_codec_that_was_used_can_be_pickled_and_copied() -> None:
    codec = Codec("big", "big5")
    frame = codec.encode(QueryServoRequest(7))
    assert codec.decode_frame(frame) == QueryServoRequest(7)
    for same in (pickle.loads(pickle.dumps(codec)), copy.copy(codec)):  # noqa: S301 - made here
        assert (same.byte_order, same.caption_encoding) == ("big", "big5")
        assert same.decode_frame(frame) == QueryServoRequest(7)


def test_what_a_board_said_can_be_given_back_exactly() -> None:
    codec = Codec()
    said = codec.encode(QueryActionResponse(7, "a\x1b[2J", (Step(1, 90, -1),)), unchecked=True)
    found = codec.decode_frame(said)
    assert isinstance(found, QueryActionResponse)
    add = AddActionRequest(found.action_id, found.action_caption, found.steps)
    assert codec.encode(add, unchecked=True)[8:-1] == said[8:-1]
    with pytest.raises(EncodeError, match="control characters"):
        codec.encode(add)
    with pytest.raises(EncodeError, match="interval: -1 is outside"):
        codec.encode(AddActionRequest(7, "a", found.steps))


def test_exact_still_refuses_what_the_wire_cannot_carry() -> None:
    with pytest.raises(EncodeError, match="interval: 40000 is outside"):
        Codec().encode(AddActionRequest(7, "a", (Step(1, 90, 40000),)), unchecked=True)


def test_a_query_is_encoded_once_and_refused_each_time() -> None:
    codec, fresh = Codec(), Codec()
    first = codec.encode(QueryServoRequest(3))
    assert codec.encode(QueryServoRequest(3)) is first
    for servo_id in range(256):
        for query in (QueryServoRequest(servo_id), QueryActionRequest(servo_id), QueryMacroRequest(servo_id)):
            assert codec.encode(query) == fresh.encode(query, unchecked=True)
    for number in range(2_000):
        codec.encode(QueryActionRequest(number))
    assert len(codec._queries) <= 1_024
    for wrong in (256, [3], "3"):
        for _ in range(2):
            with pytest.raises(EncodeError, match="servo_id"):
                codec.encode(QueryServoRequest(wrong))  # type: ignore[arg-type]
