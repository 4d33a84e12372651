"""Packets of MQTT 5, compared with those of paho-mqtt."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from servolink.fleet.publish_packets import PacketBuffer, Publication, Received, message_in, packed_properties

pytest.importorskip("paho.mqtt", reason="the extra fleet is not installed")

from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

_LONGEST = 4096
_TOPIC = "servolink/_fleet/reply/desk-0"


def message(payload: bytes, *, flags: int = 0, packet_id: int | None = None, **properties: Any) -> bytes:
    """Return a packet PUBLISH, with properties packed by paho-mqtt."""
    unpacked: Any = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
    for name, value in properties.items():
        setattr(unpacked, name, value)
    packed: bytes = unpacked.pack()
    topic, number = _TOPIC.encode(), b"" if packet_id is None else struct.pack("!H", packet_id)
    content = struct.pack("!H", len(topic)) + topic + number + packed + payload
    assert 0x80 <= len(content) < 0x4000
    return bytes((0x30 | flags, len(content) & 0x7F | 0x80, len(content) >> 7)) + content


PLAIN = message(b"x" * 120)
FULL = message(
    b'{"id":"a"}' * 9,
    flags=0x0B,
    packet_id=513,
    MessageExpiryInterval=70_000,
    ContentType="application/json",
    ResponseTopic="servolink/rex/result",
    CorrelationData=b"\0\xff",
    PayloadFormatIndicator=1,
    SubscriptionIdentifier=300,
    UserProperty=[("a", "b"), ("c", "d")],
)
PING = b"\xd0\0"
STREAM = PLAIN + PING + FULL + PING


def split(*parts: bytes) -> list[tuple[bytes, int]]:
    buffer = PacketBuffer(_LONGEST)
    return [packet for part in parts for packet in buffer.take(part)]


def test_a_message_is_read_with_all_that_belongs_to_it() -> None:
    assert message_in(PLAIN, 3) == Received(_TOPIC, b"x" * 120, 0, False, False, 0, None, None, None)
    expected = Received(_TOPIC, b'{"id":"a"}' * 9, 1, True, True, 513, 70_000, "servolink/rex/result", b"\0\xff")
    assert message_in(FULL, 3) == expected


@pytest.mark.parametrize("text", ["servolink/rex/result", "a" * 300])
def test_properties_are_packed_as_paho_unpacks_them(text: str) -> None:
    packed = packed_properties(Publication(_TOPIC, b"", 1, expiry=70_000, response_topic=text, correlation=b"\0\1"))
    found: Any = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
    assert found.unpack(packed + b"rest")[1] == len(packed)
    kept = (found.MessageExpiryInterval, found.ContentType, found.ResponseTopic, found.CorrelationData)
    assert kept == (70_000, "application/json", text, b"\0\1")


def test_a_property_that_mqtt_cannot_hold_is_refused() -> None:
    with pytest.raises(ValueError, match="65536 bytes"):
        packed_properties(Publication(_TOPIC, b"", correlation=bytes(65536)))


def test_packets_are_the_same_wherever_the_network_splits_them() -> None:
    whole = [(PLAIN, 3), (PING, 2), (FULL, 3), (PING, 2)]
    assert split(STREAM) == whole
    for at in range(len(STREAM)):
        assert split(STREAM[:at], STREAM[at:]) == whole, at
    assert split(*(bytes((byte,)) for byte in STREAM)) == whole


@pytest.mark.parametrize("start", [b"\x30\xff\xff\xff\xff", b"\x30\x80\x40", b"\x20\xff\xff\xff\x7f"])
def test_a_packet_that_is_too_long_is_refused_before_it_has_come(start: bytes) -> None:
    with pytest.raises(ValueError, match=r"longer than agreed|more than four bytes"):
        split(start)


def test_a_message_that_is_cut_or_asks_for_more_is_refused() -> None:
    for end in range(3, len(FULL) - 90):
        with pytest.raises(ValueError, match=r"longer than its packet|no end"):
            message_in(FULL[:end], 3)
    with pytest.raises(ValueError, match="QoS"):
        message_in(message(b"x" * 120, flags=0x04, packet_id=1), 3)
    with pytest.raises(ValueError, match="unknown property 7"):
        message_in(b"\x30\0\0\1a\2\7\0", 2)
    with pytest.raises(ValueError, match="do not end where they should"):
        message_in(b"\x30\0\0\1a\2\2\0more", 2)


def test_a_topic_that_is_no_text_is_of_no_board() -> None:
    assert message_in(b"\x30\0\0\2\xffa\0", 2).topic == "\ufffda"


@given(st.lists(st.binary(max_size=80)))
@example([b"\x32\x08\0\1a\0\1\0", b"\xff"])
def test_any_bytes_are_packets_or_an_error(parts: list[bytes]) -> None:
    buffer, given_so_far = PacketBuffer(_LONGEST), 0
    try:
        for part in parts:
            given_so_far += len(part)
            for packet, content in buffer.take(part):
                given_so_far -= len(packet)
                assert 2 <= content <= len(packet)
                message_in(packet, content)
    except ValueError:
        return
    assert given_so_far >= 0
