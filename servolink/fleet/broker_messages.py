"""Messages to and from a broker, apart from the library that carries them."""

from __future__ import annotations

from typing import NamedTuple

from servolink.fleet.topics import CONTENT_TYPE


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
