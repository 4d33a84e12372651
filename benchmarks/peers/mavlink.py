"""pymavlink: MAVLink 2 in its robust mode, heartbeats and GPS corrections."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from benchmarks.peers.peer import Peer, content

_dialect = import_module("pymavlink.dialects.v20.common")


class Mavlink(Peer):
    """The generated parser of the common dialect."""

    name = "pymavlink"
    package = "pymavlink"
    work = "CRC-16 with the message's own seed; message object"
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
