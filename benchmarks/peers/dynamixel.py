"""dynamixel-sdk: status packets of protocol 2.0, read from a port that has the whole stream."""

from __future__ import annotations

from importlib import import_module
from io import BytesIO
from typing import Any

from benchmarks.peers.peer import Peer, content

_sdk = import_module("dynamixel_sdk")
_OVERHEAD = 11


class _Port:
    """A port whose time-out has passed as soon as it is empty."""

    is_using = False

    def __init__(self, stream: bytes) -> None:
        self._read = BytesIO(stream).read

    def readPort(self, size: int) -> bytes:  # noqa: N802 - the name that is called
        return self._read(max(0, size))

    def isPacketTimeout(self) -> bool:  # noqa: N802 - the name that is called
        return True


class Dynamixel(Peer):
    """Its reader of status packets."""

    name = "dynamixel-sdk, protocol 2"
    package = "dynamixel-sdk"
    work = "CRC-16 by table, byte stuffing; list of numbers"
    fairness = "ours: CRC and stuffing are loops in Python; theirs: the stream is in memory"
    resync = "all bytes read so far are dropped"
    feeding = "stream"

    def __init__(self) -> None:
        """Begin a stream."""
        self._receive = _sdk.Protocol2PacketHandler().rxPacket

    @staticmethod
    def frame(size: int, number: int) -> bytes | None:
        """Return a status packet; it holds no 255, so nothing is stuffed."""
        if size > 1024:
            return None
        inside = content(size - _OVERHEAD, number).replace(b"\xff", b"\xfe")
        packet = b"\xff\xff\xfd\x00\x01" + (len(inside) + 4).to_bytes(2, "little") + b"\x55\x00" + inside
        crc = _sdk.Protocol2PacketHandler().updateCRC(0, packet, len(packet))
        return packet + int(crc).to_bytes(2, "little")

    def feed(self, chunk: bytes) -> list[Any]:
        """Read packet after packet until the port is empty."""
        port, frames = _Port(chunk), []
        receive, fine = self._receive, _sdk.COMM_SUCCESS
        while True:
            packet, result = receive(port, False)  # noqa: FBT003 - by position, as the library does
            if result == fine:
                frames.append(packet)
            elif not packet:
                return frames

    def content(self, frame: Any) -> bytes:
        """Return the bytes of the packet."""
        return bytes(frame)
