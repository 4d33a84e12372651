"""Boards of software as a USB device, exported over USB/IP."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import AbstractAsyncContextManager, contextmanager

from servolink.virtual import AttachedSession, ServedBoard
from tests.lab.usbip.device import Pipe, UsbDevice
from tests.lab.usbip.usbip_server import UsbIpServer, serve_usbip


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
