"""A board behind a TCP port: a bridge, a serial server or a virtual board."""

from __future__ import annotations

import asyncio
import socket

from servolink.errors import OpenError
from servolink.printable import printable
from servolink.transports.address import Address
from servolink.transports.stream import StreamTransport

# Where the system lets us choose: a peer that is silently gone is noticed after 10 + 3 * 5 s.
_KEEPALIVE = {"TCP_KEEPIDLE": 10, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 3}

# A system left alone takes megabytes ahead, then nothing for long: a slow line would look like a dead one.
_SEND_BUFFER = 65536


class TcpTransport(StreamTransport):
    """A TCP connection with keepalive; asyncio itself turns Nagle's delay off."""

    def __init__(self, url: str, host: str, port: int, *, timeout: float = 5.0) -> None:
        """Lead to `port` of `host`; `timeout` is in seconds and bounds the opening."""
        super().__init__(url)
        self._host = host
        self._port = port
        self._timeout = timeout

    async def _connect(self) -> asyncio.Transport:
        try:
            async with asyncio.timeout(self._timeout):
                pipe, _ = await asyncio.get_running_loop().create_connection(lambda: self, self._host, self._port)
        except (OSError, UnicodeError) as error:  # UnicodeError: the name can be no host's
            raise OpenError(f"{printable(self.url)}: {self._reason(error)}") from error
        self._tune(pipe.get_extra_info("socket"))
        return pipe

    def _reason(self, error: Exception) -> str:
        host = printable(self._host)
        if isinstance(error, TimeoutError):
            return f"no answer within {self._timeout:g} s; check address, network and firewall, or give timeout=SECONDS"
        if isinstance(error, ConnectionRefusedError):
            return (
                f"nothing listens on port {self._port} of {host}; start the bridge or virtual board, or check the port"
            )
        if isinstance(error, socket.gaierror | UnicodeError):
            return f"there is no host '{host}'; check the name, or write its IP address"
        return f"cannot connect: {printable(str(error))}; check address and network"

    @staticmethod
    def _tune(connection: socket.socket) -> None:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        for name, value in _KEEPALIVE.items():
            if hasattr(socket, name):
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def from_address(address: Address) -> TcpTransport:
    """Make the transport for `tcp://host:port?timeout=SECONDS`."""
    if not address.host or address.path.strip("/"):
        raise address.refusal("must be written tcp://host:port")
    timeout = address.number("timeout", 5.0, 0.1, 600)
    address.refuse_unknown()
    return TcpTransport(address.url, address.host, address.port_number(), timeout=timeout)
