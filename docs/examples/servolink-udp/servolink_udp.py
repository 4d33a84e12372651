"""`udp://host:port`: a board behind a bridge that puts its bytes into UDP datagrams."""

from __future__ import annotations

import asyncio
import os

from servolink import BaseTransport
from servolink.errors import OpenError
from servolink.transports.address import Address
from servolink.transports.device_info import DeviceInfo

_LARGEST = 1400  # bytes of a datagram that every network carries in one piece


class UdpTransport(BaseTransport, asyncio.DatagramProtocol):
    """A board at the other end of a pair of UDP ports."""

    def __init__(self, url: str, host: str, port: int) -> None:
        """Lead to `host` and `port`; nothing is opened yet."""
        super().__init__(url)
        self._place = (host, port)
        self._socket: asyncio.DatagramTransport | None = None
        self._freed = asyncio.Event()

    async def _open(self) -> None:
        """Bind a port of our own; OpenError if the host has no address."""
        loop = asyncio.get_running_loop()
        try:
            self._socket, _ = await loop.create_datagram_endpoint(lambda: self, remote_addr=self._place)
        except OSError as error:
            raise OpenError(f"{self.url}: {error}; is the host's name right?") from error

    def _send(self, data: bytes) -> None:
        """Send all of `data`; nothing to await, as asyncio takes each datagram at once."""
        if self._socket is not None:
            for start in range(0, len(data), _LARGEST):
                self._socket.sendto(data[start : start + _LARGEST])

    async def _close(self) -> None:
        """Free the port."""
        self._abort()
        if self._socket is not None:
            await self._freed.wait()

    def _abort(self) -> None:
        """Start to free the port."""
        if self._socket is not None:
            self._socket.abort()

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Pass on what has come; the parser finds the frames however it was cut."""
        self._deliver(data)

    def error_received(self, exc: Exception) -> None:
        """End the connection: the system reports, for example, that nobody listens there."""
        self._lose(exc)

    def connection_lost(self, exc: Exception | None) -> None:
        """Note that the port is free."""
        self._freed.set()


def from_address(address: Address) -> UdpTransport:
    """Make the transport for `udp://host:port`; servolink finds this function by its entry point."""
    address.refuse_unknown()
    if not address.host:
        raise address.refusal("must name a host: udp://192.168.1.20:9000")
    return UdpTransport(address.url, address.host, address.port_number())


def find_bridges() -> list[DeviceInfo]:
    """Return the bridges that UDP_BRIDGES names, as HOST:PORT HOST:PORT; servolink finds this function too."""
    return [DeviceInfo(f"udp://{place}", "UDP bridge") for place in os.environ.get("UDP_BRIDGES", "").split()]
