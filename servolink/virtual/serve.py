"""A virtual board that other programs can reach."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from itertools import count

from servolink.listeners import host_and_port, serve_network, serve_terminal
from servolink.transports.base import Transport
from servolink.transports.faults import Faults
from servolink.usbip.server import serve_usbip
from servolink.virtual.board import VirtualBoard
from servolink.virtual.transport import BoardDriver, FaultyVirtualTransport, VirtualTransport


@asynccontextmanager
async def serve(
    board: VirtualBoard,
    *,
    pty: bool = False,
    tcp: str | None = None,
    usbip: str | None = None,
    faults: Faults | None = None,
    seed: int = 0,
) -> AsyncIterator[list[str]]:
    """Serve `board` over a pseudo-terminal, TCP and USB/IP, both at a `HOST:PORT`; give the URLs in this order.

    Each connection draws its own `faults` from `seed`; the USB device has none, and `seed` in its serial number.
    TransportUnavailable where there are no pseudo-terminals, OpenError if a port cannot be had.
    """
    seeds = count(seed)

    def connect() -> Transport:
        line = VirtualTransport(board)
        return line if faults is None else FaultyVirtualTransport(line, faults, seed=next(seeds))

    async with AsyncExitStack() as stack:
        stack.callback(BoardDriver(board).stop)
        urls = []
        if pty:
            urls.append(await stack.enter_async_context(serve_terminal(connect)))
        if tcp is not None:
            urls.append(await stack.enter_async_context(serve_network(connect, *host_and_port(tcp))))
        if usbip is not None:
            export = serve_usbip(board, f"virtual-{seed}", *host_and_port(usbip))
            place, _ = await stack.enter_async_context(export)
            urls.append(f"usbip://{place}")
        yield urls
