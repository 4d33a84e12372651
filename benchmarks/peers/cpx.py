"""cflib: CPX packets of its serial transport, read from a port that has the whole stream."""

from __future__ import annotations

from functools import reduce
from importlib import import_module
from io import BytesIO
from operator import xor
from typing import Any
from unittest.mock import Mock, patch

from benchmarks.peers.peer import Peer, content

_cpx = import_module("cflib.cpx")
_transports: Any = import_module("cflib.cpx.transports")


class _Port:
    """A port that has been greeted; what is written to it goes nowhere."""

    def __init__(self, stream: bytes) -> None:
        self.read = BytesIO(stream).read

    def write(self, data: bytes) -> None:
        pass


class CPX(Peer):
    """Its serial transport."""

    name = "cflib, CPX"
    package = "cflib"
    work = "xor loop, confirmation of each packet; packet object"
    fairness = "ours: it reads byte by byte and confirms each packet; theirs: the stream is in memory"
    resync = "behind the damaged frame"
    builds = True
    feeding = "stream"

    def __init__(self) -> None:
        """Begin a stream."""
        with (
            patch.object(_transports, "serial", Mock(Serial=lambda *_, **__: _Port(b"\xff\0"))),
            patch.object(_transports, "print", Mock(), create=True),
        ):
            self._transport = _transports.UARTTransport("", 0)
        _transports.print = lambda *_: None  # it prints each damaged frame; the printing is not measured

    @staticmethod
    def frame(size: int, number: int) -> bytes | None:
        """Return a console packet."""
        if size > 255:
            return None
        return _frame(_cpx.CPXPacket(_cpx.CPXFunction.CONSOLE, _cpx.CPXTarget.HOST, _cpx.CPXTarget.GAP8), size, number)

    def feed(self, chunk: bytes) -> list[Any]:
        """Read packet after packet until the port is empty."""
        self._transport._serial = _Port(chunk)  # noqa: SLF001 - a port that is open already
        receive, frames = self._transport.readPacket, []
        while True:
            try:
                frames.append(receive())
            except IndexError:  # nothing left to read
                return frames
            except (RuntimeError, ValueError):  # a version, target or function that does not exist
                continue

    def content(self, frame: Any) -> bytes:
        """Return the data of the packet."""
        return bytes(frame.data)


def _frame(packet: Any, size: int, number: int) -> bytes:
    packet.data = content(size - 5, number)
    wire = bytes([0xFF, size - 3]) + bytes(packet.wireData)
    return wire + bytes([reduce(xor, wire)])
