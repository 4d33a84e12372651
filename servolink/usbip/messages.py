"""The messages of USB/IP: what a host says to a machine that exports devices, and what it is told."""

from __future__ import annotations

import struct
from typing import NamedTuple

from servolink.errors import DecodeError
from servolink.usbip.descriptors import (
    CONFIGURATION,
    FULL_SPEED,
    INTERFACE_CLASSES,
    MISCELLANEOUS,
    PRODUCT_ID,
    VENDOR_ID,
    VERSION,
)
from servolink.usbip.endpoint import Urb

OPENING_SIZE = 8
COMMAND_SIZE = 48
BUS_ID_SIZE = 32
LIST, IMPORT = 0x8005, 0x8003
"""What a host may ask first."""
BUS_ID = "1-1"
"""Where the device is said to be plugged in."""
BUSY, UNKNOWN = 2, 4
"""Why a device cannot be imported."""
MOST_DATA = 4 * 1024 * 1024
"""Bytes that one URB may send."""

_PROTOCOL = 0x0111  # USB/IP 1.1.1, which Linux speaks since 3.17
_ANSWER = 0x8000  # a request's code less this is its answer's
_SUBMIT, _UNLINK, _SUBMITTED, _UNLINKED = 1, 2, 3, 4
_INWARD = 0x80
_OPENING = struct.Struct(">HHI")
_DEVICE = struct.Struct(">256s32s3I3H6B")
_HEADER = struct.Struct(">5I")  # command, number, device, direction, endpoint
_SUBMIT_REST = struct.Struct(">Ii3i8s")  # flags, length, three fields of isochronous transfers, setup
_RESULT_REST = struct.Struct(">ii3i8x")  # status, length, three fields of isochronous transfers
_UNLINKED_REST = struct.Struct(">i24x")


class Unlink(NamedTuple):
    """The host wants a URB back."""

    number: int
    urb: int


def parse_opening(data: bytes) -> int:
    """Return what the host asks first; DecodeError if it speaks another version."""
    version, code, _ = _OPENING.unpack(data)
    if version != _PROTOCOL:
        raise DecodeError(f"USB/IP version {version:#06x}, where {_PROTOCOL:#06x} is spoken", data)
    return int(code)


def device_list() -> bytes:
    """Answer a request for the list of devices."""
    interfaces = b"".join(bytes((*INTERFACE_CLASSES[number], 0)) for number in sorted(INTERFACE_CLASSES))
    return _OPENING.pack(_PROTOCOL, LIST - _ANSWER, 0) + struct.pack(">I", 1) + _device() + interfaces


def import_granted() -> bytes:
    """Answer a request for the device: it is the host's until the connection ends."""
    return _OPENING.pack(_PROTOCOL, IMPORT - _ANSWER, 0) + _device()


def import_refused(reason: int) -> bytes:
    """Answer a request for a device that cannot be had."""
    return _OPENING.pack(_PROTOCOL, IMPORT - _ANSWER, reason)


def parse_command(data: bytes) -> Urb | Unlink:
    """Read a command of a host that has the device; DecodeError for what no host says.

    What a URB sends follows: `length` bytes if it goes out.
    """
    command, number, _, direction, endpoint = _HEADER.unpack_from(data)
    rest = data[_HEADER.size :]
    if command == _UNLINK:
        return Unlink(number, int.from_bytes(rest[:4], "big"))
    _, length, _, packets, _, setup = _SUBMIT_REST.unpack(rest)
    if command != _SUBMIT or direction > 1 or endpoint >= _INWARD:
        raise DecodeError(f"USB/IP command {command}, direction {direction}, endpoint {endpoint}: there is none", data)
    if packets > 0:
        raise DecodeError("an isochronous transfer, for which the device has no endpoint", data)
    if length < 0 or (not direction and length > MOST_DATA):
        raise DecodeError(f"a transfer of {length} bytes, where 0..{MOST_DATA} are taken", data)
    return Urb(number, endpoint | _INWARD if direction else endpoint, length, setup)


def submitted(urb: Urb, status: int) -> bytes:
    """Give a URB back."""
    return _HEADER.pack(_SUBMITTED, urb.number, 0, 0, 0) + _RESULT_REST.pack(status, urb.moved, 0, 0, 0) + urb.received


def unlinked(unlink: Unlink, status: int) -> bytes:
    """Tell what became of a URB that the host wanted back."""
    return _HEADER.pack(_UNLINKED, unlink.number, 0, 0, 0) + _UNLINKED_REST.pack(status)


def _device() -> bytes:
    bus, number = 1, 1
    ids = VENDOR_ID, PRODUCT_ID, VERSION
    counts = CONFIGURATION, 1, len(INTERFACE_CLASSES)
    path = f"/sys/devices/virtual/usb1/{BUS_ID}".encode()
    return _DEVICE.pack(path, BUS_ID.encode(), bus, number, FULL_SPEED, *ids, *MISCELLANEOUS, *counts)
