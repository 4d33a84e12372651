"""pyubx2: messages of u-blox receivers, read from a stream that is there as a whole."""

from __future__ import annotations

from importlib import import_module
from io import BytesIO
from typing import Any

from benchmarks.peers.peer import Peer, content

_ubx = import_module("pyubx2")


class UBX(Peer):
    """Its reader, for UBX messages alone."""

    name = "pyubx2"
    package = "pyubx2"
    work = "Fletcher loop; message object with all fields"
    fairness = "ours: its checksum is a loop in Python, and every field gets a name; theirs: the stream is in memory"
    resync = "behind the damaged frame"
    builds = True
    feeding = "stream"

    @staticmethod
    def frame(size: int, number: int) -> bytes | None:
        """Return navigation rates (14 bytes), 14 satellites (184) or 112 raw measurements (3,608)."""
        group = "CFG", "CFG-RATE", content(6, number)
        if size == 186:
            group = "NAV", "NAV-SAT", content(4, number) + bytes([1, 14, 0, 0]) + content(12 * 14, number)
        elif size == 3611:
            group = "RXM", "RXM-RAWX", content(11, number) + bytes([112, 1, 1, 0, 0]) + content(32 * 112, number)
        name, identity, payload = group
        return bytes(_ubx.UBXMessage(name, identity, _ubx.GET, payload=payload).serialize())

    def feed(self, chunk: bytes) -> list[Any]:
        """Read message after message."""
        reader = _ubx.UBXReader(BytesIO(chunk), protfilter=_ubx.UBX_PROTOCOL, quitonerror=_ubx.ERR_IGNORE)
        frames: list[Any] = []
        while True:
            try:
                raw, message = reader.read()
            except UnicodeDecodeError:  # noise that begins as a line of text does
                continue
            if raw is None:
                return frames
            frames.append(message)

    def content(self, frame: Any) -> bytes:
        """Return the bytes of the frame."""
        return bytes(frame.serialize())
