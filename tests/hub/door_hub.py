"""A hub with a virtual board and real doors, for tests; and programs without the library on sockets."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any, Self

from servolink.boards import HubClaim
from servolink.client import connect
from servolink.hub.doors.frame_doors import pty_door, tcp_door
from servolink.hub.doors.socket_door import OpenChannel, socket_door
from servolink.hub.hub import Hub, share
from servolink.support import user_folder
from servolink.transports import NetworkPlace
from servolink.virtual import BoardKind, VirtualBoard, VirtualTransport

GUARD = 240.0
"""Seconds after which a test of real I/O has failed."""


def on_hub(
    use: Callable[[Hub, VirtualBoard], Awaitable[None]], kind: BoardKind = BoardKind.DEFAULT, **options: Any
) -> None:
    """Run `use` with a hub for a virtual board of three servos, in real time; no task may be left behind."""

    async def main() -> None:
        virtual = VirtualBoard(3, kind=kind)
        async with (
            asyncio.timeout(GUARD),
            connect(VirtualTransport(virtual), angle_unit=None, **options) as board,
            share(board, name="rex") as hub,
        ):
            await use(hub, virtual)
        await asyncio.sleep(0)
        assert asyncio.all_tasks() == {asyncio.current_task()}

    asyncio.run(main())


@asynccontextmanager
async def sharing(hub: Hub, open_channel: OpenChannel | None = None) -> AsyncIterator[str]:
    """Open the socket door, and announce it; yield the address."""
    with await HubClaim.of(hub.name) as claim:
        async with socket_door(hub, claim, open_channel) as url:
            claim.announce("tcp://127.0.0.1:1")
            yield url


def on_network(hub: Hub) -> AbstractAsyncContextManager[str]:
    """Open a TCP door of this machine; the address comes out."""
    return tcp_door(hub, "127.0.0.1:0")


def on_serial_port(hub: Hub) -> AbstractAsyncContextManager[str]:
    """Open the door for serial programs; the address comes out."""
    return pty_door(hub)


def raw_socket(name: str = "rex") -> socket.socket:
    """Connect to the socket of a hub without any check."""
    line = socket.socket(socket.AF_UNIX)
    line.settimeout(0)
    line.connect(str(user_folder("runtime") / f"{name}.sock"))
    return line


async def raw_tcp(url: str) -> RawLine:
    """Connect to a TCP door."""
    line = socket.socket()
    line.settimeout(0)
    await asyncio.get_running_loop().sock_connect(line, NetworkPlace.parse(url.removeprefix("tcp://")))
    return RawLine(line)


class RawLine:
    """A connection on which a test sends and reads bytes."""

    def __init__(self, line: socket.socket) -> None:
        self.line = line
        self._loop = asyncio.get_running_loop()

    async def send(self, data: bytes) -> None:
        await self._loop.sock_sendall(self.line, data)

    async def read(self, size: int = 65536) -> bytes:
        """Return what comes next; empty at the end."""
        try:
            return await self._loop.sock_recv(self.line, size)
        except ConnectionResetError:
            return b""

    async def until(self, count: int) -> bytes:
        """Return `count` bytes, fewer if the connection ends."""
        data = b""
        while len(data) < count and (more := await self.read(count - len(data))):
            data += more
        return data

    async def until_end(self) -> bytes:
        data = b""
        while more := await self.read():
            data += more
        return data

    async def greet(self, **greeting: Any) -> dict[str, Any]:
        """Send a greeting and return the answer."""
        await self.send(json.dumps({"servolink": 1, "wants": "frames", "who": "a test"} | greeting).encode() + b"\n")
        line = b""
        while not line.endswith(b"\n") and (more := await self.read()):
            line += more
        answer: dict[str, Any] = json.loads(line)
        return answer

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.line.close()


async def until(condition: Callable[[], object]) -> None:
    """Wait until something is so; `on_hub` limits the time."""
    while not condition():
        await asyncio.sleep(0.001)
