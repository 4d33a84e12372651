"""`udp://host:port`: a board behind a bridge that puts its bytes into UDP datagrams."""

from __future__ import annotations

import asyncio

from servolink.errors import ConnectionLost, OpenError
from servolink.escaping import escape
from servolink.transports.address import Address
from servolink.transports.base import Receiver

_LARGEST = 1400  # bytes of a datagram that every network carries in one piece


class UdpTransport(asyncio.DatagramProtocol):
    """A board at the other end of a pair of UDP ports."""

    def __init__(self, url: str, host: str, port: int) -> None:
        """Lead to `host` and `port`; nothing is opened yet."""
        self.url = url
        self._place = (host, port)
        self._receiver: Receiver | None = None
        self._socket: asyncio.DatagramTransport | None = None
        self._cause: Exception | None = None
        self._ended = asyncio.Event()

    async def open(self, receiver: Receiver) -> None:
        """Bind a port of our own; OpenError if the host has no address or this transport was used before."""
        if self._receiver is not None or self._ended.is_set():
            raise OpenError(f"{escape(self.url)}: a transport is opened once; make another")
        self._receiver = receiver
        loop = asyncio.get_running_loop()
        try:
            self._socket, _ = await loop.create_datagram_endpoint(lambda: self, remote_addr=self._place)
        except OSError as error:
            raise OpenError(f"{escape(self.url)}: {error}; is the host's name right?") from error

    async def send(self, data: bytes) -> None:
        """Send all of `data`, or raise ConnectionLost; asyncio takes a datagram without waiting."""
        if self._socket is None or self._ended.is_set():
            raise ConnectionLost(f"{escape(self.url)}: it is not open") from self._cause
        for start in range(0, len(data), _LARGEST):
            self._socket.sendto(data[start : start + _LARGEST])

    async def close(self) -> None:
        """Free the port; may be called again."""
        if self._socket is None:
            self._ended.set()
            return
        self._socket.abort()
        await self._ended.wait()

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Pass on what has come; the parser finds the frames however it was cut."""
        if self._receiver is not None:
            self._receiver.data(data)

    def error_received(self, exc: Exception) -> None:
        """End the connection: the system says that nobody listens there."""
        if self._socket is not None and self._cause is None:
            self._cause = exc
            self._socket.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell the receiver, exactly once, that this is the end."""
        self._ended.set()
        if self._receiver is not None:
            self._receiver.lost(self._cause or exc)


def from_address(address: Address) -> UdpTransport:
    """Make the transport for `udp://host:port`; servolink finds this function by its entry point."""
    address.refuse_unknown()
    if not address.host:
        raise address.refusal("must name a host: udp://192.168.1.20:9000")
    return UdpTransport(address.url, address.host, address.port_number())
