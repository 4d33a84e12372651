"""pymavlink: MAVLink 2 in its robust mode, heartbeats and GPS corrections."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

from benchmarks.peers.peer import Peer, content

_dialect = import_module("pymavlink.dialects.v20.common")


@cache
def _near(size: int) -> list[Any]:
    """Return the messages with about the payload of a heartbeat (9 bytes) or of a GPS correction (182)."""
    payload, least, most = {14: (9, 5, 7), 186: (182, 1, 0)}.get(size, (0, 0, 0))
    return [
        message
        for _, message in sorted(_dialect.mavlink_map.items())
        if payload - least <= message.unpacker.size <= payload + most
    ]


def _packed(message: Any) -> bytes:
    """Return the frame of a message whose fields are all filled, so that no zeros are cut off."""
    fields = [
        _value(message.fieldtypes[message.fieldnames.index(name)], message.array_lengths[place])
        for name, place in ((name, message.ordered_fieldnames.index(name)) for name in message.fieldnames)
    ]
    return bytes(message(*fields).pack(_dialect.MAVLink(None)))


def _value(kind: str, length: int) -> Any:
    if kind == "char":
        return b"a" * max(1, length)
    return [1] * length if length else 1


class Mavlink(Peer):
    """The generated parser of the common dialect."""

    name = "pymavlink"
    package = "pymavlink"
    work = "CRC-16 with the message's own seed; message object"
    fairness = "ours: its CRC is a loop in Python; its frames of 14 bytes have 21"
    resync = "behind the damaged frame"
    builds = True

    def __init__(self) -> None:
        """Begin a stream."""
        self._link = _dialect.MAVLink(None)
        self._link.robust_parsing = True

    @staticmethod
    def frame(size: int, number: int) -> bytes | None:
        """Return a heartbeat (21 bytes) or a GPS correction (194 bytes)."""
        if size == 14:
            message = _dialect.MAVLink_heartbeat_message(2, 3, 81, number, 4, 3)
        elif size == 186:
            message = _dialect.MAVLink_gps_rtcm_data_message(1, 180, [*content(179, number), 1])
        else:
            return None
        return bytes(message.pack(_dialect.MAVLink(None)))

    def feed(self, chunk: bytes) -> list[Any]:
        """Parse; what is no frame comes as an object of its own."""
        found = self._link.parse_buffer(chunk)
        return [] if found is None else [message for message in found if message.get_msgId() >= 0]

    def content(self, frame: Any) -> bytes:
        """Return the bytes of the frame."""
        return bytes(frame.get_msgbuf())
