"""A host for the USB/IP server, which says byte by byte what Linux would say."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import NamedTuple

IMPORT = struct.pack(">HHI32s", 0x0111, 0x8003, 0, b"1-1")
IMPORT_ANSWER_SIZE = 8 + 312
SUBMIT, UNLINK, SUBMITTED, UNLINKED = 1, 2, 3, 4


class Said(NamedTuple):
    """What the server gave back: a URB (`command` 3) or what became of one (4)."""

    command: int
    number: int
    status: int
    length: int
    data: bytes


def submit(number: int, endpoint: int, length: int = 0, data: bytes = b"", setup: bytes = bytes(8)) -> bytes:
    """Write a URB to `endpoint`, whose bit 7 is the direction towards the host."""
    inward = endpoint >> 7
    length = length if inward else len(data)
    header = struct.pack(">5I", SUBMIT, number, 0x10001, inward, endpoint & 0x7F)
    return header + struct.pack(">Ii3i8s", 0, length, 0, -1, 0, setup) + data


def unlink(number: int, urb: int) -> bytes:
    return struct.pack(">6I24x", UNLINK, number, 0x10001, 0, 0, urb)


class UsbHost:
    """Has the device; `inward` remembers which URBs carry data back."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self.writer = writer
        self._inward: set[int] = set()
        self._number = 0

    def submit(self, endpoint: int, length: int = 0, data: bytes = b"", setup: bytes = bytes(8)) -> int:
        self._number += 1
        if endpoint >> 7:
            self._inward.add(self._number)
        self.writer.write(submit(self._number, endpoint, length, data, setup))
        return self._number

    def unlink(self, urb: int) -> int:
        self._number += 1
        self.writer.write(unlink(self._number, urb))
        return self._number

    async def next(self) -> Said:
        command, number, _, _, _, status, length = struct.unpack(">5Iii", await self._reader.readexactly(28))
        await self._reader.readexactly(20)
        if command == UNLINKED:
            return Said(command, number, status, 0, b"")
        data = await self._reader.readexactly(length) if number in self._inward else b""
        return Said(command, number, status, length, data)

    async def transfer(self, endpoint: int, length: int = 0, data: bytes = b"", setup: bytes = bytes(8)) -> Said:
        """Submit a URB and wait for it, with no other outstanding."""
        number = self.submit(endpoint, length, data, setup)
        said = await self.next()
        assert (said.command, said.number) == (SUBMITTED, number)
        return said

    async def control(self, kind: int, request: int, value: int, index: int, length: int, data: bytes = b"") -> Said:
        setup = struct.pack("<BBHHH", kind, request, value, index, length or len(data))
        return await self.transfer(kind & 0x80, length, data, setup)

    async def ended(self) -> bool:
        """Wait until the server has ended the connection, whatever it says before."""
        try:
            while await self._reader.read(65536):
                pass
        except ConnectionError:
            pass
        return True


@asynccontextmanager
async def attached(host: str, port: int) -> AsyncIterator[UsbHost]:
    """Import the device."""
    reader, writer = await asyncio.open_connection(host, port)
    try:
        writer.write(IMPORT)
        answer = await reader.readexactly(IMPORT_ANSWER_SIZE)
        assert answer[:8] == struct.pack(">HHI", 0x0111, 0x0003, 0)
        yield UsbHost(reader, writer)
    finally:
        writer.transport.abort()
