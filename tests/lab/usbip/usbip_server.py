"""Server of USB/IP, exporting a USB device to one host at a time."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager, asynccontextmanager
from typing import TypeAlias

from servolink.errors import DecodeError
from servolink.transports import Stranger, listen
from tests.lab.usbip import usbip_messages
from tests.lab.usbip.descriptors import HID_IN
from tests.lab.usbip.device import UsbDevice
from tests.lab.usbip.endpoint import Urb

MAX_OUTSTANDING = 4096
"""Most outstanding URBs of a host; the drivers of Linux use some dozens."""
MAX_PENDING_BYTES = 16 * 1024 * 1024
"""Most unaccepted bytes of a host: the limit of Linux for all programs together."""

HID_INTERVAL = 0.001
"""Seconds between two reports, as in the descriptor of the endpoint."""

_OPENING_LIMIT = 10.0  # seconds for the first request of a host


class Attachment:
    """Attachment of the device to a host, from the import to the end of the connection."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, serial_number: str) -> None:
        """Attach a new device with `serial_number` to the host."""
        self.device = UsbDevice(serial_number, self._return_urb)
        self._reader = reader
        self._writer = writer
        self._reports: deque[bytes] = deque()  # reports to the host, fetched by polling
        self._poll: asyncio.TimerHandle | None = None

    async def serve(self) -> None:
        """Execute commands until an OSError or EOFError ends the connection. Raise DecodeError for a wrong command."""
        try:
            while True:
                self._carry_out(await self._command())
                await self._writer.drain()
        finally:
            self._end_polling()

    async def _command(self) -> Urb | usbip_messages.Unlink:
        command = usbip_messages.parse_command(await self._reader.readexactly(usbip_messages.COMMAND_SIZE))
        if isinstance(command, Urb) and not command.inward:
            command.data = await self._reader.readexactly(command.length)
        return command

    def _carry_out(self, command: Urb | usbip_messages.Unlink) -> None:
        if isinstance(command, usbip_messages.Unlink):
            status = self.device.unlink(command.urb)
            self._end_polling()  # returned URBs must precede the message about their withdrawal
            self._write(usbip_messages.unlinked(command, status))
            return
        self.device.submit(command)
        if self.device.outstanding > MAX_OUTSTANDING or self.device.pending_bytes > MAX_PENDING_BYTES:
            raise DecodeError(
                f"too much is outstanding: {self.device.outstanding} URBs with {self.device.pending_bytes} bytes"
            )

    def _return_urb(self, urb: Urb, status: int) -> None:
        if urb.endpoint != HID_IN:
            self._write(usbip_messages.submitted(urb, status))
            return
        # A bus transfers one report each millisecond. Many at once would overrun the buffer of Linux for 64 reports.
        self._reports.append(usbip_messages.submitted(urb, status))
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
"""Maker of the context of a device, inside which the pipes of the device are used."""


class UsbIpServer:
    """Server at a port, for hosts to find and attach the device."""

    def __init__(self, use: Use, serial_number: str) -> None:
        """Export a device with `serial_number`; each attachment uses a new device inside a context of `use`."""
        self._use = use
        self._serial_number = serial_number
        self._host: asyncio.StreamWriter | None = None

    @property
    def attached(self) -> bool:
        """Whether the device is attached to a host."""
        return self._host is not None

    def unplug(self) -> None:
        """Unplug the device: the host loses the device immediately. Any host can attach the device again."""
        if self._host is not None:
            self._host.transport.abort()

    async def converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, stranger: Stranger) -> None:
        """Serve a connection until its end."""
        try:
            await self._welcome(reader, writer)
            if self._host is writer and stranger.admit("usbip"):
                attachment = Attachment(reader, writer, self._serial_number)
                with self._use(attachment.device):
                    await attachment.serve()
        except (DecodeError, OSError, EOFError):
            return  # usual end, also for connections of other programs than hosts
        finally:
            if self._host is writer:
                self._host = None

    async def _welcome(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Respond to the first request of a host, for the list of devices or for an import, and serve the import."""
        code = usbip_messages.parse_opening(await reader.readexactly(usbip_messages.OPENING_SIZE))
        if code == usbip_messages.IMPORT:
            bus_id = (await reader.readexactly(usbip_messages.BUS_ID_SIZE)).rstrip(b"\0")
            if bus_id == usbip_messages.BUS_ID.encode() and self._host is None:
                self._host = writer
                writer.write(usbip_messages.import_granted())
                return
            is_exported = bus_id == usbip_messages.BUS_ID.encode()
            writer.write(usbip_messages.import_refused(usbip_messages.BUSY if is_exported else usbip_messages.UNKNOWN))
        elif code == usbip_messages.LIST:
            writer.write(usbip_messages.device_list())
        writer.close()
        await writer.wait_closed()


@asynccontextmanager
async def serve_usbip(use: Use, serial_number: str, host: str, port: int) -> AsyncIterator[tuple[str, UsbIpServer]]:
    """Export a device at `host` and `port`; yield the place, HOST:PORT, and the server."""
    server = UsbIpServer(use, serial_number)
    async with listen(server.converse, host, port, seconds=_OPENING_LIMIT) as place:
        yield place, server
