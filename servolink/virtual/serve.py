"""Server of a virtual board for other programs."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager, contextmanager
from itertools import count

from servolink.listeners.forwarding import serve_network, serve_terminal
from servolink.listeners.tcp import host_and_port
from servolink.protocol.frame import MAGIC
from servolink.transports.base import Transport
from servolink.transports.line_faults import Faults
from servolink.usbip.device import Pipe, UsbDevice
from servolink.usbip.usbip_server import UsbIpServer, serve_usbip
from servolink.virtual.transport import (
    AttachedSession,
    BoardDriver,
    BoardTransport,
    FaultyVirtualTransport,
    ServedBoard,
)


@asynccontextmanager
async def serve(
    board: ServedBoard,
    *,
    pty: bool = False,
    tcp: str | None = None,
    usbip: str | None = None,
    faults: Faults | None = None,
    seed: int = 0,
) -> AsyncIterator[list[str]]:
    """Serve `board` over a pseudo-terminal, and at `HOST:PORT` over TCP and USB/IP; yield the URLs in this order.

    Each connection has separate `faults`, beginning with `seed`. The USB device has no faults, and the serial number
    `virtual-SEED`.

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
            urls.append(await stack.enter_async_context(serve_network(connect, *host_and_port(tcp), begins_with=MAGIC)))
        if usbip is not None:
            export = serve_usb_device(board, f"virtual-{seed}", *host_and_port(usbip))
            place, _ = await stack.enter_async_context(export)
            urls.append(f"usbip://{place}")
        yield urls


def serve_usb_device(
    board: ServedBoard, serial_number: str, host: str, port: int
) -> AbstractAsyncContextManager[tuple[str, UsbIpServer]]:
    """Export `board` as a USB device at `host` and `port`; the context yields the place, HOST:PORT, and the server.

    A BoardDriver must run inside the context, as otherwise the time of the board stands still.
    """
    return serve_usbip(lambda device: plugged(board, device), serial_number, host, port)


@contextmanager
def plugged(board: ServedBoard, device: UsbDevice) -> Iterator[None]:
    """Attach each pipe of `device` to `board` as a separate host."""
    sessions = [board.attach(pipe.send, _unsent(pipe), lambda: None) for pipe in device.pipes]
    for pipe, session in zip(device.pipes, sessions, strict=True):
        pipe.receive = _receive(session)
    try:
        yield
    finally:
        board.detach(*sessions, now=asyncio.get_running_loop().time())


def _unsent(pipe: Pipe) -> Callable[[], int]:
    return lambda: pipe.to_host.waiting


def _receive(session: AttachedSession) -> Callable[[bytes], None]:
    loop = asyncio.get_running_loop()
    return lambda data: session.receive(data, loop.time())
