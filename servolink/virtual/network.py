"""A TCP port at which hosts reach the board, several at a time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any, TypeAlias

from servolink.errors import OpenError, TransportUnavailable
from servolink.printable import printable
from servolink.transports.address import Address
from servolink.virtual.bridge import Connect, bridge

Converse: TypeAlias = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Coroutine[Any, Any, None]]
"""Serves one connection, and returns when it has ended."""

_HIGHEST_PORT = 65535


def host_and_port(text: str) -> tuple[str, int]:
    """Split `HOST:PORT`; port 0 means any free one; TransportUnavailable says what is wrong."""
    address = Address.parse(f"tcp://{text}")
    if not address.host or address.path or address.options or not address.port.isdecimal():
        raise TransportUnavailable(f"{printable(text)!r} is not HOST:PORT, as in 127.0.0.1:0")
    if int(address.port) > _HIGHEST_PORT:
        raise TransportUnavailable(f"port {address.port} is outside 0..{_HIGHEST_PORT}")
    return address.host, int(address.port)


@asynccontextmanager
async def serve_network(connect: Connect, host: str, port: int) -> AsyncIterator[str]:
    """Serve a conversation to each host that connects to `host` and `port`, and give the URL."""
    async with listen(lambda reader, writer: bridge(reader, writer, connect), host, port) as place:
        yield f"tcp://{place}"


@asynccontextmanager
async def listen(converse: Converse, host: str, port: int) -> AsyncIterator[str]:
    """Let each host that connects to `host` and `port` `converse`, and give the place as HOST:PORT."""
    conversations: set[asyncio.Task[None]] = set()

    def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        conversation = asyncio.ensure_future(converse(reader, writer))
        conversations.add(conversation)
        conversation.add_done_callback(conversations.discard)

    place = f"{printable(host)}:{port}"
    try:
        server = await asyncio.start_server(accept, host, port)
    except OSError as error:
        raise OpenError(f"cannot listen at {place}: {printable(str(error))}; try another port, or 0") from error
    except UnicodeError as error:
        raise OpenError(f"cannot listen at {place}: no host can have this name; write its IP address") from error
    try:
        name, number = server.sockets[0].getsockname()[:2]
        yield f"[{name}]:{number}" if ":" in name else f"{name}:{number}"
    finally:
        server.close()
        for conversation in conversations:
            conversation.cancel()
        if conversations:
            await asyncio.wait(set(conversations))
        await server.wait_closed()
