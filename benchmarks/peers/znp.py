"""zigpy-znp: the serial protocol of Texas Instruments' radios."""

from __future__ import annotations

from functools import reduce
from importlib import import_module
from operator import xor
from random import Random
from typing import Any

from benchmarks.peers.peer import Peer, content

_uart = import_module("zigpy_znp.uart")


class Znp(Peer):
    """Its asyncio protocol."""

    name = "zigpy-znp"
    package = "zigpy-znp"
    work = "xor, frame objects"
    fairness = "ours: its xor is a loop in Python"
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
        return None if size > 255 else _request(size, number, 0x81)

    @staticmethod
    def mixed(size: int, number: int) -> bytes | None:
        """Return one of 44 requests."""
        return None if size > 255 else _request(size, number, Random(number).randrange(1, 45))

    def feed(self, chunk: bytes) -> list[Any]:
        """Hand the chunk to the protocol, which calls `frame_received` for each frame."""
        self._frames.clear()
        self._protocol.data_received(chunk)
        return self._frames

    def content(self, frame: Any) -> bytes:
        """Return header and data."""
        return bytes(frame.serialize())


def _request(size: int, number: int, command: int) -> bytes:
    payload = bytes([size - 5, 0x44, command]) + content(size - 5, number)
    return b"\xfe" + payload + bytes([reduce(xor, payload)])
