"""Messages of USB/IP between a host and a machine with exported devices."""

from __future__ import annotations

import struct
from typing import NamedTuple

from servolink.errors import DecodeError
from tests.lab.usbip.descriptors import (
    CONFIGURATION,
    FULL_SPEED,
    INTERFACE_CLASSES,
    MISCELLANEOUS,
    PRODUCT_ID,
    VENDOR_ID,
    VERSION,
)
from tests.lab.usbip.endpoint import Urb

OPENING_SIZE = 8
COMMAND_SIZE = 48
BUS_ID_SIZE = 32
LIST, IMPORT = 0x8005, 0x8003
"""Codes of the first request of a host: list of devices, or import of a device."""
BUS_ID = "1-1"
"""Port of the exported device, as reported to hosts."""
BUSY, UNKNOWN = 2, 4
"""Statuses of a refused import of a device."""
MAX_DATA = 4 * 1024 * 1024
"""Most bytes in a URB."""

_PROTOCOL = 0x0111  # USB/IP 1.1.1, the version of Linux since 3.17
_RESPONSE = 0x8000  # difference between the codes of a request and its response
_SUBMIT, _UNLINK, _SUBMITTED, _UNLINKED = 1, 2, 3, 4
_INWARD = 0x80
_OPENING = struct.Struct(">HHI")
_DEVICE = struct.Struct(">256s32s3I3H6B")
_HEADER = struct.Struct(">5I")  # command, number, device, direction, endpoint
_SUBMIT_REST = struct.Struct(">Ii3i8s")  # flags, length, three fields of isochronous transfers, setup
_RESULT_REST = struct.Struct(">ii3i8x")  # status, length, three fields of isochronous transfers
_UNLINKED_REST = struct.Struct(">i24x")


class Unlink(NamedTuple):
    """Request to withdraw a URB."""

    number: int
    urb: int


def parse_opening(data: bytes) -> int:
    """Return the code of the first request. Raise DecodeError for another version of USB/IP."""
    version, code, _ = _OPENING.unpack(data)
    if version != _PROTOCOL:
        raise DecodeError(f"the USB/IP version must be {_PROTOCOL:#06x}, not {version:#06x}", data)
    return int(code)


def device_list() -> bytes:
    """Return the response to a request for the list of devices."""
    interfaces = b"".join(bytes((*INTERFACE_CLASSES[number], 0)) for number in sorted(INTERFACE_CLASSES))
    return _OPENING.pack(_PROTOCOL, LIST - _RESPONSE, 0) + struct.pack(">I", 1) + _device() + interfaces


def import_granted() -> bytes:
    """Return the response to an accepted import, valid until the connection ends."""
    return _OPENING.pack(_PROTOCOL, IMPORT - _RESPONSE, 0) + _device()


def import_refused(reason: int) -> bytes:
    """Return the response to an import refused for `reason`."""
    return _OPENING.pack(_PROTOCOL, IMPORT - _RESPONSE, reason)


def parse_command(data: bytes) -> Urb | Unlink:
    """Return the command of a host after an import. Raise DecodeError for an impossible command.

    The command of an outgoing URB is followed by its data, `length` bytes.
    """
    command, number, _, direction, endpoint = _HEADER.unpack_from(data)
    rest = data[_HEADER.size :]
    if command == _UNLINK:
        return Unlink(number, int.from_bytes(rest[:4], "big"))
    _, length, _, packets, _, setup = _SUBMIT_REST.unpack(rest)
    if command != _SUBMIT or direction > 1 or endpoint >= _INWARD:
        raise DecodeError(f"USB/IP command {command}, direction {direction}, endpoint {endpoint} do not exist", data)
    if packets > 0:
        raise DecodeError("the device has no endpoint for an isochronous transfer", data)
    if length < 0 or (not direction and length > MAX_DATA):
        raise DecodeError(f"a transfer must have 0..{MAX_DATA} bytes, not {length}", data)
    return Urb(number, endpoint | _INWARD if direction else endpoint, length, setup)


def submitted(urb: Urb, status: int) -> bytes:
    """Return the message with a completed URB."""
    return _HEADER.pack(_SUBMITTED, urb.number, 0, 0, 0) + _RESULT_REST.pack(status, urb.moved, 0, 0, 0) + urb.received


def unlinked(unlink: Unlink, status: int) -> bytes:
    """Return the message with the status of a URB withdrawn by the host."""
    return _HEADER.pack(_UNLINKED, unlink.number, 0, 0, 0) + _UNLINKED_REST.pack(status)


def _device() -> bytes:
    bus, number = 1, 1
    ids = VENDOR_ID, PRODUCT_ID, VERSION
    counts = CONFIGURATION, 1, len(INTERFACE_CLASSES)
    path = f"/sys/devices/virtual/usb1/{BUS_ID}".encode()
    return _DEVICE.pack(path, BUS_ID.encode(), bus, number, FULL_SPEED, *ids, *MISCELLANEOUS, *counts)
