"""zigpy-znp: the serial protocol of Texas Instruments' radios."""

from __future__ import annotations

from functools import reduce
from importlib import import_module
from operator import xor
from typing import Any

from benchmarks.peers.peer import Peer, content

_uart = import_module("zigpy_znp.uart")


class Znp(Peer):
    """Its asyncio protocol."""

    name = "zigpy-znp"
    package = "zigpy-znp"
    work = "xor, frame objects"
    resync = "the next start byte inside the damaged frame"
    builds = True

    def __init__(self) -> None:
        """Begin a stream."""
        self._frames: list[Any] = []
        self._protocol = _uart.ZnpMtProtocol(self)
        self.frame_received = self._frames.append

    @staticmethod
    def frame(size: int, number: int) -> bytes | None:
        """Return an asynchronous request of the AF subsystem."""
        if size > 255:
            return None
        payload = bytes([size - 5, 0x44, 0x81]) + content(size - 5, number)
        return b"\xfe" + payload + bytes([reduce(xor, payload)])

    def feed(self, chunk: bytes) -> list[Any]:
        """Hand the chunk to the protocol, which calls `frame_received` for each frame."""
        self._frames.clear()
        self._protocol.data_received(chunk)
        return self._frames

    def content(self, frame: Any) -> bytes:
        """Return header and data."""
        return bytes(frame.serialize())
