"""Export a USB device over USB/IP, to one host at a time."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager, asynccontextmanager
from typing import TypeAlias

from servolink.errors import DecodeError
from servolink.listeners import listen
from servolink.usbip import messages
from servolink.usbip.descriptors import HID_IN
from servolink.usbip.device import UsbDevice
from servolink.usbip.endpoint import Urb

MOST_OUTSTANDING = 4096
"""URBs that a host may have under way; Linux's drivers have some dozens."""
MOST_HELD = 16 * 1024 * 1024
"""Bytes that a host may have sent and the device not taken; as many as Linux gives all its USB programs."""

HID_INTERVAL = 0.001
"""Seconds between two reports, as the descriptor of their endpoint has it."""

_OPENING_LIMIT = 10.0  # seconds for a host to say what it wants


class Conversation:
    """A host that has the device, at the other end of a connection."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, serial_number: str) -> None:
        """Plug a device with `serial_number` into the host."""
        self.device = UsbDevice(serial_number, self._give_back)
        self._reader = reader
        self._writer = writer
        self._reports: deque[bytes] = deque()  # to the host, which polls for them
        self._poll: asyncio.TimerHandle | None = None

    async def serve(self) -> None:
        """Obey until the connection ends, by an OSError or EOFError, or DecodeError for what no host says."""
        try:
            while True:
                self._obey(await self._command())
                await self._writer.drain()
        finally:
            self._end_polling()

    async def _command(self) -> Urb | messages.Unlink:
        command = messages.parse_command(await self._reader.readexactly(messages.COMMAND_SIZE))
        if isinstance(command, Urb) and not command.inward:
            command.data = await self._reader.readexactly(command.length)
        return command

    def _obey(self, command: Urb | messages.Unlink) -> None:
        if isinstance(command, messages.Unlink):
            status = self.device.unlink(command.urb)
            self._end_polling()  # what is given back comes before what is told of it
            self._write(messages.unlinked(command, status))
            return
        self.device.submit(command)
        if self.device.outstanding > MOST_OUTSTANDING or self.device.held > MOST_HELD:
            raise DecodeError(f"{self.device.outstanding} transfers with {self.device.held} bytes are under way")

    def _give_back(self, urb: Urb, status: int) -> None:
        if urb.endpoint != HID_IN:
            self._write(messages.submitted(urb, status))
            return
        # A bus brings a report each millisecond; all at once they would overrun the 64 for which Linux has room.
        self._reports.append(messages.submitted(urb, status))
        if self._poll is None:
            self._fetch_report()

    def _fetch_report(self) -> None:
        self._poll = None
        if self._reports:
            self._write(self._reports.popleft())
            self._poll = asyncio.get_running_loop().call_later(HID_INTERVAL, self._fetch_report)

    def _end_polling(self) -> None:
        if self._poll is not None:
            self._poll.cancel()
            self._poll = None
        while self._reports:
            self._write(self._reports.popleft())

    def _write(self, message: bytes) -> None:
        if not self._writer.is_closing():
            self._writer.write(message)


Use: TypeAlias = Callable[[UsbDevice], AbstractContextManager[None]]
"""Makes the context in which a device works: something handles what its pipes receive, and sends."""


class UsbIpServer:
    """A port at which hosts find the device and attach it."""

    def __init__(self, use: Use, serial_number: str) -> None:
        """Export a device with `serial_number`; each time that it is attached, a new one works in `use`."""
        self._use = use
        self._serial_number = serial_number
        self._host: asyncio.StreamWriter | None = None

    @property
    def attached(self) -> bool:
        """Whether a host has the device."""
        return self._host is not None

    def unplug(self) -> None:
        """Pull the plug: the host loses the device at once; it, or another, may attach it again."""
        if self._host is not None:
            self._host.transport.abort()

    async def converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection until it ends."""
        try:
            async with asyncio.timeout(_OPENING_LIMIT):
                await self._welcome(reader, writer)
            if self._host is writer:
                conversation = Conversation(reader, writer, self._serial_number)
                with self._use(conversation.device):
                    await conversation.serve()
        except (DecodeError, OSError, EOFError):
            return  # how every conversation ends, also with a host that says what no host says
        finally:
            if self._host is writer:
                self._host = None
            writer.transport.abort()

    async def _welcome(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer what a host asks first: for the list, or for the device, which it then has."""
        code = messages.parse_opening(await reader.readexactly(messages.OPENING_SIZE))
        if code == messages.IMPORT:
            bus_id = (await reader.readexactly(messages.BUS_ID_SIZE)).rstrip(b"\0")
            if bus_id == messages.BUS_ID.encode() and self._host is None:
                self._host = writer
                writer.write(messages.import_granted())
                return
            known = bus_id == messages.BUS_ID.encode()
            writer.write(messages.import_refused(messages.BUSY if known else messages.UNKNOWN))
        elif code == messages.LIST:
            writer.write(messages.device_list())
        writer.close()
        await writer.wait_closed()


@asynccontextmanager
async def serve_usbip(use: Use, serial_number: str, host: str, port: int) -> AsyncIterator[tuple[str, UsbIpServer]]:
    """Export a device at `host` and `port`; yield the place, HOST:PORT, and the server."""
    server = UsbIpServer(use, serial_number)
    async with listen(server.converse, host, port) as place:
        yield place, server
