"""Transport for serial ports, through pyserial-asyncio."""

from __future__ import annotations

import asyncio
import errno
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

import serial  # type: ignore[import-untyped]
import serial_asyncio  # type: ignore[import-untyped]

from servolink.errors import OpenError
from servolink.transports.address import Address
from servolink.transports.serial_ports import list_ports
from servolink.transports.stream import StreamTransport

_CLOSE_LIMIT = 0.2  # most seconds for which closing blocks the event loop
_OPENING_LIMIT = 0.5  # seconds for which a cancelled opening waits for the system
_READ_SIZE = 4096  # bytes, as much as Linux holds for a port; pyserial-asyncio would read 1024
_ABSENT = {errno.ENOENT, errno.ENODEV, errno.ENXIO}
_BUSY = {errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK}
_FORBIDDEN = {errno.EACCES, errno.EPERM}


class _Port(serial.Serial):  # type: ignore[misc]  # pyserial has no types
    """Port that reports failures to `failed`: pyserial-asyncio would log the error or close twice."""

    failed: Callable[[Exception], None]
    descriptor = -1
    """Descriptor of the open port; -1 for a closed port, and on Windows."""

    def open(self) -> None:
        super().open()
        with suppress(OSError):  # on Windows ports have no descriptor
            self.descriptor = self.fileno()

    def read(self, size: int = 1) -> bytes:
        try:
            return bytes(super().read(size))
        except serial.SerialException as error:
            self.failed(error)
            return b""

    def write(self, b: Any, /) -> int | None:
        try:
            return super().write(b)  # type: ignore[no-any-return]  # likewise
        except serial.SerialException as error:
            self.failed(error)
            raise BlockingIOError from error  # the system accepted no bytes

    @property
    def in_waiting(self) -> int:
        try:
            return int(super().in_waiting)
        except OSError as error:
            self.failed(error)
            return 0

    def flush(self) -> None:
        """Drop unsent bytes: pyserial would wait for the device, possibly forever."""
        try:
            if self.out_waiting:  # not otherwise: a pseudo-terminal would drop bytes still unread by the other end
                self.reset_output_buffer()
        except OSError:
            pass  # unplugged: nothing is left to drop

    def close(self) -> None:
        """Close in a thread: for a stuck device Linux waits 30 s, and the event loop must not block."""
        self.descriptor = -1
        if not self.is_open or sys.is_finalizing():  # a thread started at the end of the program never runs
            super().close()
            return
        closing = threading.Thread(target=super().close, name="servolink port", daemon=True)
        closing.start()
        closing.join(_CLOSE_LIMIT)


class SerialTransport(StreamTransport):
    """Serial port, opened for exclusive use, with 8 data bits, no parity and 1 stop bit."""

    def __init__(self, url: str, device: str, *, baudrate: int = 115200, dtr: bool = False, rts: bool = False) -> None:
        """Use the port `device`; `dtr` and `rts` are levels of control lines, which reset some boards."""
        super().__init__(url)
        self.bytes_per_second = baudrate / 10
        """Least capacity of the line; USB ignores the baud rate."""
        self._device = device
        self._port = _Port(baudrate=baudrate, exclusive=True)
        self._port.dtr = dtr
        self._port.rts = rts
        self._port.failed = self._unplugged

    @property
    def baudrate(self) -> int:
        """Baud rate of the port, in bits per second."""
        return int(self._port.baudrate)

    def set_baudrate(self, baudrate: int) -> bool:
        """Change the baud rate of the open port immediately; return whether the port supports `baudrate`."""
        try:
            self._port.baudrate = baudrate
        except (OSError, ValueError):  # pyserial raises ValueError for rates of no port
            return False
        self.bytes_per_second = baudrate / 10
        return True

    async def connect(self) -> asyncio.Transport:
        """Open the port in a thread. Raise OpenError with the remedy."""
        loop = asyncio.get_running_loop()
        opening = loop.run_in_executor(None, self._open_port)
        try:
            await asyncio.shield(opening)
        except asyncio.CancelledError:
            opening.add_done_callback(self._close_late)
            # Otherwise an immediate new attempt would find the port in use. A port stuck in opening is closed later.
            await asyncio.wait((opening,), timeout=_OPENING_LIMIT)
            raise
        pipe, _ = await serial_asyncio.connection_for_serial(loop, lambda: self, self._port)
        pipe._max_read_size = _READ_SIZE  # noqa: SLF001 - there is no other way
        if self._port.descriptor >= 0:
            pipe._read_ready = partial(self._read, pipe._read_ready)  # noqa: SLF001 - likewise
        return pipe  # type: ignore[no-any-return]  # pyserial-asyncio has no types

    def _open_port(self) -> None:
        """Open the port, perhaps blocking; pyserial drops stale input."""
        try:
            self._port.port = self._device
            self._port.open()
        except Exception as error:  # OSError, ValueError for baud rate or name, or termios.error
            raise OpenError(f"{self.url}: {_reason(self._device, error)}") from error

    def _close_late(self, opening: asyncio.Future[None]) -> None:
        if not opening.cancelled() and opening.exception() is None:
            self._port.close()

    def _unplugged(self, error: Exception) -> None:
        disconnected = ConnectionResetError("the device is gone; is it unplugged or switched off?")
        disconnected.__cause__ = error
        self._lose(disconnected)

    def _release(self) -> None:
        self._port.close()

    def _read(self, through_pyserial: Callable[[], None]) -> None:
        """Read without `select`, as the event loop has found bytes; for a failure, pyserial finds the cause."""
        try:
            data = os.read(self._port.descriptor, _READ_SIZE)
        except OSError:
            data = b""
        if data:
            self._deliver(data)
        else:
            through_pyserial()

    def _write(self, pipe: asyncio.Transport, data: bytes) -> None:
        """Write as many bytes as possible immediately, usually all, and not one turn of the loop later."""
        try:
            written = 0 if self._full else os.write(self._port.descriptor, data)
        except OSError:  # of which the pipe will find the cause
            written = 0
        if written < len(data):
            pipe.write(data[written:])

    def _unsent(self) -> int:
        try:
            return super()._unsent() + int(self._port.out_waiting)
        except OSError:
            return 0  # unplugged: no more bytes will leave


def _reason(device: str, error: Exception) -> str:
    code = getattr(error, "errno", None)
    text = str(error)  # on Windows, pyserial has only the text
    if code in _ABSENT or "FileNotFoundError" in text:
        return f"there is no {device}; plug the board in and switch it on; {_present_ports()}"
    if code in _BUSY or "PermissionError" in text:
        return f"{device} is in use; close the program that has it (another servolink, a serial monitor, ModemManager)"
    if code in _FORBIDDEN:
        return (
            f"no permission for {device}; on Linux join its group, `sudo usermod -aG dialout $USER` "
            f"(uucp on Arch), then log out and in"
        )
    if code in {errno.EISDIR, errno.ENOTTY} or "Could not configure port" in text:
        return f"{device} is not a serial port; {_present_ports()}"
    return f"cannot open {device}: {text}"


def _present_ports() -> str:
    ports = ", ".join(sorted(port.device for port in list_ports()))
    return f"the serial ports here: {ports}" if ports else "no serial port is here"


def from_address(address: Address) -> SerialTransport:
    """Make the transport for `serial:///dev/ttyACM0?baudrate=115200&dtr=0&rts=0` or `serial://COM3`."""
    device = address.serial_device
    if not device or address.port:
        raise address.refusal("must name a device: serial:///dev/ttyACM0 or serial://COM3")
    baudrate = address.integer("baudrate", 115200, 50, 12_000_000)
    dtr = address.flag("dtr", default=False)
    rts = address.flag("rts", default=False)
    address.refuse_unknown()
    return SerialTransport(address.url, device, baudrate=baudrate, dtr=dtr, rts=rts)
