"""Which values a board takes."""

from __future__ import annotations

import msgspec

from servolink.protocol.packet import Packet


def in_range(packet: Packet) -> bool:
    """Tell whether all values of `packet` are allowed by its declaration; decoding lets everything pass."""
    try:
        msgspec.convert(msgspec.to_builtins(packet), type(packet))
    except msgspec.ValidationError:
        return False
    return True
