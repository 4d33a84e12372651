"""Messages to and from a broker, and their packets of MQTT 5.

paho-mqtt takes 33 µs to read an answer of a board, eight times as long as the controller takes for all else. After a
stop thousands of answers come together, so packets PUBLISH are read here; paho-mqtt handles all others.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Final, NamedTuple

from servolink.fleet.topics import CONTENT_TYPE

PUBLISH = 3
"""Type of the packet with a message: the upper four bits of the first byte."""

_EXPIRY, _CONTENT_TYPE, _RESPONSE_TOPIC, _CORRELATION, _SUBSCRIPTION = 2, 3, 8, 9, 11
_SIZES: Final = {1: 1, _EXPIRY: 4, 35: 2}  # bytes of properties with a fixed size
_TEXTS: Final = {_CONTENT_TYPE: 1, _RESPONSE_TOPIC: 1, _CORRELATION: 1, 38: 2}  # number of texts, each with its length
_LONGEST_TEXT = 0xFFFF
_LONGEST_NUMBER = 4  # bytes


class Received(NamedTuple):
    """A message from the broker."""

    topic: str
    payload: bytes
    qos: int
    is_retained: bool
    is_duplicate: bool
    packet_id: int
    """MQTT packet identifier, for the acknowledgement."""
    expiry: int | None
    """Seconds left when the broker sent the message; None for no limit."""
    response_topic: str | None
    correlation: bytes | None


class Publication(NamedTuple):
    """A message to send."""

    topic: str
    payload: bytes | str
    qos: int = 0
    retain: bool = False
    expiry: int | None = None
    """Seconds after which the broker drops the message."""
    response_topic: str | None = None
    correlation: bytes | None = None
    content_type: str = CONTENT_TYPE


class PacketBuffer:
    """Received bytes whose packet is not complete yet."""

    def __init__(self, longest: int) -> None:
        """Accept packets of up to `longest` bytes."""
        self._longest = longest
        self._parts: list[bytes] = []
        self._missing = 0

    def take(self, data: bytes) -> Iterator[tuple[bytes, int]]:
        """Yield the packets that `data` completes, each with the offset of its content.

        Raise ValueError for a packet that is too long, or whose length cannot be read.
        """
        self._parts.append(data)
        self._missing -= len(data)
        if self._missing > 0:  # of a long packet, whose parts are joined once
            return
        data, start = b"".join(self._parts), 0
        self._parts.clear()
        while (found := _number(data, start + 1)) is not None:
            size, content = found
            if content + size - start > self._longest:
                raise ValueError(f"a packet of {size} bytes is longer than agreed")
            self._missing = content + size - len(data)
            if self._missing > 0:
                break
            yield data[start : content + size], content - start
            start = content + size
        if start < len(data):
            self._parts.append(data[start:])


def message_in(packet: bytes, at: int) -> Received:
    """Return the message in a packet PUBLISH whose content begins at the offset `at`.

    Raise ValueError for a packet that does not follow MQTT 5.
    """
    flags = packet[0] & 0x0F
    qos, packet_id = flags >> 1 & 0x03, 0
    topic, at = _text(packet, at)
    if qos:
        packet_id, at = int.from_bytes(packet[at : at + 2], "big"), at + 2
    if qos > 1 or (found := _number(packet, at)) is None:  # no subscription asks for QoS 2
        raise ValueError("a message has a QoS that was not asked for, or no end")
    size, at = found
    properties = _properties(packet, at, at + size)
    response_topic, correlation = properties.get(_RESPONSE_TOPIC), properties.get(_CORRELATION)
    expiry = properties.get(_EXPIRY)
    return Received(
        _decoded(topic),
        packet[at + size :],
        qos,
        bool(flags & 0x01),
        bool(flags & 0x08),
        packet_id,
        None if expiry is None else int.from_bytes(expiry, "big"),
        None if response_topic is None else _decoded(response_topic),
        correlation,
    )


def packed_properties(message: Publication) -> bytes:
    """Return the properties of a message as bytes, with their length. Raise ValueError for a text over 64 KB."""
    parts = []
    if message.expiry is not None:
        parts.append(struct.pack("!BI", _EXPIRY, message.expiry))
    for kind, text in (
        (_CONTENT_TYPE, message.content_type.encode()),
        (_RESPONSE_TOPIC, None if message.response_topic is None else message.response_topic.encode()),
        (_CORRELATION, message.correlation),
    ):
        if text is not None:
            if len(text) > _LONGEST_TEXT:
                raise ValueError(f"a property of {len(text)} bytes is longer than MQTT allows")
            parts.append(struct.pack("!BH", kind, len(text)) + text)
    content = b"".join(parts)
    size, length = len(content), bytearray()
    while size > 0x7F:
        length.append(size & 0x7F | 0x80)
        size >>= 7
    return bytes((*length, size)) + content


def _number(data: bytes, at: int) -> tuple[int, int] | None:
    """Return a number of variable length at `at`, and the offset of its end; None for an incomplete number."""
    value = shift = 0
    for end in range(at, min(at + _LONGEST_NUMBER, len(data))):
        byte = data[end]
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, end + 1
        shift += 7
    if len(data) >= at + _LONGEST_NUMBER:
        raise ValueError("a length has more than four bytes")
    return None


def _text(packet: bytes, at: int) -> tuple[bytes, int]:
    """Return a text at `at`, and the offset of its end. Raise ValueError if the packet ends before."""
    begin = at + 2
    end = begin + int.from_bytes(packet[at:begin], "big")
    if end > len(packet):
        raise ValueError("a text is longer than its packet")
    return packet[begin:end], end


def _properties(packet: bytes, at: int, end: int) -> dict[int, bytes]:
    """Return the properties between two offsets, by their identifier. Raise ValueError if they do not end there."""
    if end > len(packet):
        raise ValueError("the properties of a message are longer than its packet")
    found = {}
    while at < end:
        kind, at = packet[at], at + 1
        if (size := _SIZES.get(kind)) is not None:
            found[kind] = packet[at : at + size]
            at += size
        elif (texts := _TEXTS.get(kind)) is not None:
            for _ in range(texts):
                found[kind], at = _text(packet, at)
        elif kind == _SUBSCRIPTION and (number := _number(packet, at)) is not None:
            _, at = number
        else:
            raise ValueError(f"a message has an unknown property {kind}")
    if at != end:
        raise ValueError("the properties of a message do not end where they should")
    return found


def _decoded(text: bytes) -> str:
    """Return a topic; one that is not UTF-8 becomes a topic that no board has."""
    return text.decode("utf-8", "replace")
