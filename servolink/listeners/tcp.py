"""TCP addresses in the form HOST:PORT, and sockets that listen at them."""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from ipaddress import ip_address
from typing import Any

from servolink.errors import OpenError, TransportUnavailable
from servolink.escaping import quote
from servolink.transports.address import Address

_MAX_PORT = 65535
_BACKLOG = 100
_PORT_ATTEMPTS = 10
_NO_SUCH_FAMILY = {errno.EAFNOSUPPORT, errno.EADDRNOTAVAIL}  # a machine without IPv6


def host_and_port(text: str) -> tuple[str, int]:
    """Split `HOST:PORT`. Port 0 means any free port. Raise TransportUnavailable if `text` is something else."""
    address = Address.parse(f"tcp://{text}")
    if not address.host or address.path or "?" in text or not address.port.isdecimal():
        raise TransportUnavailable(f"{quote(text)} must be HOST:PORT, as in 127.0.0.1:0")
    if int(address.port) > _MAX_PORT:
        raise TransportUnavailable(f"a port must be 0..{_MAX_PORT}, not {address.port}")
    return address.host, int(address.port)


def joined(host: str, port: int) -> str:
    """Return HOST:PORT."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def place_of(listening: Sequence[socket.socket]) -> str:
    """Return the address of listening sockets, as HOST:PORT."""
    return joined(*listening[0].getsockname()[:2])


def reached_by(url: str) -> str:
    """Return the users who can connect to a server at `url` (`tcp://ADDRESS:PORT`), in readable form."""
    host, _ = host_and_port(url.removeprefix("tcp://"))
    return "every user of this machine" if ip_address(host).is_loopback else "everybody in the network"


async def listening_sockets(host: str, port: int) -> list[socket.socket]:
    """Return listening sockets for all addresses of `host`, with the same port.

    `*` is every address of this machine. Raise OpenError if an address or the port is not available.
    """
    place = joined(host, port)
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
        raise OpenError(f"cannot listen at {place}: {reason}; {_remedy(error)}") from error
    except UnicodeError as error:
        raise OpenError(f"cannot listen at {place}: no host can have such a name; write an IP address") from error


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
