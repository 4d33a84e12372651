"""TCP addresses in the form HOST:PORT, and sockets that listen at them."""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from ipaddress import ip_address
from typing import Any, NamedTuple

from servolink.errors import OpenError, TransportUnavailable, quote
from servolink.transports.address import Address

_MAX_PORT = 65535
_BACKLOG = 100
_PORT_ATTEMPTS = 10
_NO_SUCH_FAMILY = {errno.EAFNOSUPPORT, errno.EADDRNOTAVAIL}  # a machine without IPv6


class NetworkPlace(NamedTuple):
    """Host and port where a server listens; `str` is HOST:PORT."""

    host: str
    """Name or address; `*` for every address of this machine."""
    port: int
    """Port 0 for any free port."""

    @classmethod
    def parse(cls, text: str) -> NetworkPlace:
        """Return the place in `HOST:PORT`. Raise TransportUnavailable if `text` is something else."""
        address = Address.parse(f"tcp://{text}")
        if not address.host or address.path or "?" in text or not address.port.isdecimal():
            raise TransportUnavailable(f"{quote(text)} must be HOST:PORT, as in 127.0.0.1:0")
        if int(address.port) > _MAX_PORT:
            raise TransportUnavailable(f"a port must be 0..{_MAX_PORT}, not {address.port}")
        return cls(address.host, int(address.port))

    @classmethod
    def of(cls, listening: Sequence[socket.socket]) -> NetworkPlace:
        """Return the place of listening sockets."""
        return cls(*listening[0].getsockname()[:2])

    def __str__(self) -> str:
        """Return HOST:PORT, as `parse` reads it."""
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    @property
    def reached_by(self) -> str:
        """Users who can connect to a server at an IP address, in readable form."""
        return "every user of this machine" if ip_address(self.host).is_loopback else "everybody in the network"

    async def listen(self) -> list[socket.socket]:
        """Return listening sockets for all addresses of the host, with the same port.

        Raise OpenError if an address or the port is not available.
        """
        host, port = self
        try:
            found = await asyncio.get_running_loop().getaddrinfo(
                None if host == "*" else host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
            )
            addresses = list(dict.fromkeys((family, address) for family, _, _, _, address in found))
            for _ in range(_PORT_ATTEMPTS - 1 if port == 0 else 0):
                try:
                    return _bind(addresses, port)
                except OSError:  # a port that is free at one address may be in use at the next
                    continue
            return _bind(addresses, port)
        except OSError as error:
            reason = (error.strerror or str(error)).partition(" (while")[0]  # create_server repeats the address
            raise OpenError(f"cannot listen at {self}: {reason}; {_remedy(error)}") from error
        except UnicodeError as error:
            text = f"cannot listen at {self}: no host can have such a name; write an IP address"
            raise OpenError(text) from error


def _remedy(error: OSError) -> str:
    if isinstance(error, socket.gaierror) or error.errno in _NO_SUCH_FAMILY:
        return "use an address of this machine, such as 127.0.0.1, or * for every address"
    return "try another port, or 0"


def _bind(addresses: Iterable[tuple[socket.AddressFamily, Any]], port: int) -> list[socket.socket]:
    with ExitStack() as bound:
        listening: list[socket.socket] = []
        missing: OSError | None = None
        for family, (host, _, *rest) in addresses:
            try:
                one = socket.create_server((host, port, *rest), family=family, backlog=_BACKLOG)
            except OSError as error:
                if error.errno not in _NO_SUCH_FAMILY:
                    raise
                missing = error
                continue
            bound.callback(one.close)
            one.settimeout(0)
            listening.append(one)
            port = one.getsockname()[1]
        if missing is not None and not listening:
            raise missing
        bound.pop_all()
        return listening
