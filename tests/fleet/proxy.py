"""A network between a broker and a program that a test can cut, hold up, and listen to."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from tests.fleet.mosquitto import Broker

PUBACK = b"\x40"


class Proxy:
    """Passes bytes on to a broker."""

    def __init__(self, broker: Broker) -> None:
        self.connections = 0
        self.loses_confirmations = False
        """Whether the broker's confirmations of messages do not arrive, if each comes alone."""
        self._broker = broker
        self._writers: set[asyncio.StreamWriter] = set()
        self._flows = asyncio.Event()
        self._flows.set()
        self._refuses = False
        self._port = 0

    @property
    def url(self) -> str:
        """The address of the broker behind this network."""
        return f"mqtt://127.0.0.1:{self._port}"

    def hold(self) -> None:
        """Let nothing through, as a network that has stalled does, and lose nothing."""
        self._flows.clear()

    def flow(self) -> None:
        """Let everything through again, and new connections too."""
        self._refuses = False
        self._flows.set()

    def cut(self) -> None:
        """End all connections, and refuse new ones."""
        self._refuses = True
        for writer in self._writers:
            writer.transport.abort()

    async def serve(self, near: asyncio.StreamReader, to_near: asyncio.StreamWriter) -> None:
        if self._refuses:
            to_near.transport.abort()
            return
        self.connections += 1
        with suppress(OSError, asyncio.CancelledError):
            far, to_far = await asyncio.open_connection("127.0.0.1", self._broker.port)
            self._writers |= {to_near, to_far}
            try:
                async with asyncio.TaskGroup() as group:
                    group.create_task(self._pass(near, to_far))
                    group.create_task(self._pass(far, to_near))
            except* OSError:
                pass
            finally:
                self._writers -= {to_near, to_far}

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(65536):
            await self._flows.wait()
            if not (self.loses_confirmations and data.startswith(PUBACK)):
                writer.write(data)
        writer.transport.abort()


@asynccontextmanager
async def proxy_to(broker: Broker) -> AsyncIterator[Proxy]:
    """Yield a network to the broker."""
    proxy = Proxy(broker)
    server = await asyncio.start_server(proxy.serve, "127.0.0.1", 0)
    proxy._port = server.sockets[0].getsockname()[1]
    try:
        yield proxy
    finally:
        server.close()
        proxy.cut()
        proxy.flow()
