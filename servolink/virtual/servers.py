"""Server of a virtual board for other programs."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from itertools import count

from servolink.protocol import MAGIC
from servolink.transports import Faults, NetworkPlace, Transport, serve_network, serve_terminal
from servolink.virtual.transport import BoardDriver, BoardTransport, FaultyVirtualTransport, ServedBoard


@asynccontextmanager
async def serve(
    board: ServedBoard,
    *,
    pty: bool = False,
    tcp: str | None = None,
    faults: Faults | None = None,
    seed: int = 0,
) -> AsyncIterator[list[str]]:
    """Serve `board` over a pseudo-terminal, and at `HOST:PORT` over TCP; yield the URLs in this order.

    Each connection has separate `faults`, beginning with `seed`.

    Raises:
        TransportUnavailable: The system has no pseudo-terminals.
        OpenError: A port is in use or forbidden.

    """
    seeds = count(seed)

    def connect() -> Transport:
        line = BoardTransport(board)
        return line if faults is None else FaultyVirtualTransport(line, faults, seed=next(seeds))

    async with AsyncExitStack() as stack:
        stack.callback(BoardDriver(board).stop)
        urls = []
        if pty:
            urls.append(await stack.enter_async_context(serve_terminal(connect)))
        if tcp is not None:
            urls.append(
                await stack.enter_async_context(serve_network(connect, *NetworkPlace.parse(tcp), begins_with=MAGIC))
            )
        yield urls
