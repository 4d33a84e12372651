"""Transport for a board on a pair of USB bulk endpoints, through pyusb and libusb."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from time import monotonic
from typing import Any

import usb.core  # type: ignore[import-untyped]
import usb.util  # type: ignore[import-untyped]
from msgspec.structs import replace

from servolink.errors import OpenError
from servolink.transports.address import Address
from servolink.transports.device_info import UDEV_CURE, PortIdentity, choose_only
from servolink.transports.threaded import DeviceTransport
from servolink.transports.usb_devices import Endpoints, UsbInterface, backend, boards

_TRANSFER_LIMIT = 250  # milliseconds; on some systems, transfers cancelled sooner have lost packets
_WRITE_SIZE = 16384
_STALE_LIMIT = 1.0  # seconds for which a device may send responses to an earlier program
_HALTS = 10  # most halts in a row without data: more are no mere disturbance


class BulkDevice:
    """Vendor-defined USB interface with a pair of bulk endpoints."""

    def __init__(
        self,
        url: str,
        expected: PortIdentity,
        *,
        incoming: int | None = None,
        outgoing: int | None = None,
        library: Any = None,
    ) -> None:
        """Use the only fitting interface, with its first bulk endpoints; `library` is the backend of pyusb."""
        self._url = url
        self._expected = expected
        self._incoming = incoming
        self._outgoing = outgoing
        self._library = library

    def open(self) -> OpenUsb:
        """Find and open the interface, and drop responses to an earlier program. Raise OpenError with the remedy."""
        library = self._library or backend()
        found = boards(library, self._expected)
        kind = f"USB device {self._expected}"
        if self._expected.interface is not None:
            kind += f" with a pair of bulk endpoints on interface {self._expected.interface}"
        board = choose_only(self._url, kind, found, [] if found else boards(library))
        endpoints = board.endpoints(self._incoming, self._outgoing)
        if endpoints is None:
            present = ", ".join(f"{each.bEndpointAddress:#04x}" for each in board.interface)
            raise OpenError(f"{self._url}: the interface has no such endpoints; it has {present}")
        undo = ExitStack()
        try:
            _claim(board, undo)
            opened = OpenUsb(board.device, endpoints, undo)
            opened.drop_stale()
        except Exception as error:
            undo.close()
            raise OpenError(f"{self._url}: {_reason(error)}") from error
        return opened


class OpenUsb:
    """Open USB interface, claimed from the system."""

    def __init__(self, device: Any, endpoints: Endpoints, undo: ExitStack) -> None:
        """Use `device` of pyusb; `undo` releases the device."""
        self._device = device
        self._endpoints = endpoints
        self._undo = undo
        self._halts = 0

    def drop_stale(self) -> None:
        """Drop unread responses to an earlier program: the first request would get a wrong response."""
        until = monotonic() + _STALE_LIMIT
        while self._packet() is not None and monotonic() < until:
            pass

    def read(self) -> bytes:
        """Return the next packet, or b"" after the time limit."""
        return self._packet() or b""

    def pieces(self, frame: bytes) -> Iterator[bytes]:
        """Cut `frame` into transfers; an empty packet marks the end after a full packet."""
        for start in range(0, len(frame), _WRITE_SIZE):
            yield frame[start : start + _WRITE_SIZE]
        if len(frame) % self._endpoints.outgoing_size == 0:
            yield b""

    def write(self, piece: bytes) -> bytes | None:
        """Offer `piece`; return the rest after the time limit, None if the device accepted all bytes."""
        try:
            written = self._device.write(self._endpoints.outgoing, piece, _TRANSFER_LIMIT)
        except usb.core.USBTimeoutError:
            return piece
        except (usb.core.USBError, ValueError) as error:  # ValueError: gone before its descriptors were needed
            self._recover(self._endpoints.outgoing, error)
            return None  # the number of accepted bytes is unknown, and a repeated command could be carried out twice
        return piece[written:] if written < len(piece) else None

    def close(self) -> None:
        """Release the interface, if necessary to the driver of the kernel."""
        self._undo.close()

    def _packet(self) -> bytes | None:
        """Return the next packet, perhaps empty, or None after the time limit."""
        # One packet at a time: after a full packet with no empty packet, a longer transfer would wait for more.
        try:
            packet = bytes(self._device.read(self._endpoints.incoming, self._endpoints.incoming_size, _TRANSFER_LIMIT))
        except usb.core.USBTimeoutError:
            return None
        except (usb.core.USBError, ValueError) as error:  # ValueError: gone before its descriptors were needed
            self._recover(self._endpoints.incoming, error)
            return b""
        self._halts = 0
        return packet

    def _recover(self, endpoint: int, error: Exception) -> None:
        """Clear a halt of `endpoint`. Raise ConnectionLost for any other error."""
        self._halts += 1
        if getattr(error, "errno", None) != errno.EPIPE or self._halts > _HALTS:
            raise _disconnected(error) from error
        try:
            self._device.clear_halt(endpoint)
        except usb.core.USBError as failure:
            raise _disconnected(failure) from failure


def _claim(board: UsbInterface, undo: ExitStack) -> None:
    """Claim the interface; `undo` gets the steps to release what was claimed, also after a failure."""
    device, number = board.device, board.number
    undo.callback(_quietly, usb.util.dispose_resources, device)
    _configure(device, board.configuration.bConfigurationValue)
    with suppress(NotImplementedError):  # drivers cannot be detached on every system
        if device.is_kernel_driver_active(number):
            device.detach_kernel_driver(number)
            undo.callback(_quietly, device.attach_kernel_driver, number)
    usb.util.claim_interface(device, number)
    undo.callback(_quietly, usb.util.release_interface, device, number)
    if board.interface.bAlternateSetting:
        device.set_interface_altsetting(board.interface)


def _configure(device: Any, configuration: int) -> None:
    """Set the configuration unless already set: setting the same value again would reset the whole device."""
    try:
        if device.get_active_configuration().bConfigurationValue == configuration:
            return
    except usb.core.USBError as error:
        if error.errno is not None:  # the error "not configured" of pyusb has no number
            raise
    device.set_configuration(configuration)


def _quietly(free: Callable[..., object], *arguments: object) -> None:
    """Call `free`, and ignore the errors of an unplugged device."""
    with suppress(usb.core.USBError, NotImplementedError):
        free(*arguments)


def _reason(error: Exception) -> str:
    code = getattr(error, "errno", None)
    if code in {errno.EACCES, errno.EPERM}:
        return f"no permission for the USB device; {UDEV_CURE}"
    if code == errno.EBUSY:
        return "the device is in use; close the program that has it (another servolink, a virtual machine)"
    if code in {errno.ENODEV, errno.ENOENT, errno.EIO, errno.ENXIO}:
        return "the device was unplugged just now; plug the board in again"
    if isinstance(error, NotImplementedError):
        return "Windows has no driver for access by programs; install WinUSB for the device, with the program Zadig"
    return f"cannot open it: {error}; plug the board in again"


def _disconnected(error: Exception) -> ConnectionResetError:
    return ConnectionResetError(f"the device is gone: {error}; is it unplugged or switched off?")


def from_address(address: Address) -> DeviceTransport:
    """Make the transport for `usb://VID:PID/SERIAL?interface=0&in=0x81&out=0x01`."""
    expected = PortIdentity.from_address(address)
    interface = address.integer("interface", -1, 0, 255)
    if interface >= 0:
        expected = replace(expected, interface=interface)
    incoming = address.integer("in", 0, 0x81, 0x8F) or None
    outgoing = address.integer("out", 0, 0x01, 0x0F) or None
    address.refuse_unknown()
    return DeviceTransport(address.url, BulkDevice(address.url, expected, incoming=incoming, outgoing=outgoing))
