"""A receiver for tests: keeps what a transport brings and lets a test wait for it."""

from __future__ import annotations

import asyncio

from servolink.protocol import Codec, FrameParser, Packet
from servolink.transports import NetworkPlace, Transport

GUARD = 120.0
"""Seconds after which a test that waits for real input gives up."""
ANY_PORT = "127.0.0.1:0"


async def client(url: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Connect to a place, or to the place of an address, without a transport."""
    return await asyncio.open_connection(*NetworkPlace.parse(url.removeprefix("tcp://")))


class Heard:
    """Packets that came over a transport, and how it ended."""

    def __init__(self, codec: Codec | None = None) -> None:
        self.packets: list[Packet] = []
        self.ends: list[Exception | None] = []
        self._codec = codec or Codec()
        self._parser = FrameParser(self._codec.byte_order)
        self._news = asyncio.Event()

    def data(self, chunk: bytes) -> None:
        self.packets += [self._codec.decode(*frame) for frame in self._parser.feed(chunk)]
        self._news.set()

    def lost(self, error: Exception | None) -> None:
        self.ends.append(error)
        self._news.set()

    async def until(self, count: int) -> list[Packet]:
        """Wait until `count` packets came, and return all."""
        async with asyncio.timeout(GUARD):
            while len(self.packets) < count:
                await self._wait()
        return self.packets

    async def until_lost(self) -> Exception | None:
        """Wait for the end and return its error."""
        async with asyncio.timeout(GUARD):
            while not self.ends:
                await self._wait()
        return self.ends[0]

    async def _wait(self) -> None:
        self._news.clear()
        await self._news.wait()


async def ask(transport: Transport, heard: Heard, packet: Packet) -> Packet:
    """Send one request and return the next packet that comes."""
    count = len(heard.packets)
    await transport.send(Codec().encode(packet))
    return (await heard.until(count + 1))[count]
