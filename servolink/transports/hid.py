"""Transport for a board on an HID interface, through hidapi."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from enum import IntEnum

from servolink.errors import OpenError
from servolink.support import claim_device
from servolink.transports.address import Address
from servolink.transports.device_info import UDEV_CURE, PortIdentity, choose_only
from servolink.transports.hid_devices import (
    LIBRARY_LOCK,
    VENDOR_PAGES,
    Handle,
    HidApi,
    HidInterface,
    boards,
    load_hidapi,
)
from servolink.transports.threaded import DeviceTransport

_READ_LIMIT = 100  # milliseconds; without a limit only the device could end a blocking read
_USUAL_SIZE = 64


class HidDevice:
    """HID interface whose reports form a stream of bytes."""

    def __init__(
        self,
        api: HidApi,
        url: str,
        expected: PortIdentity,
        *,
        usage_page: int | None = None,
        report_id: int | None = None,
        report_size: int | None = None,
    ) -> None:
        """Use the only fitting interface; for None, read page, id or size from the descriptor of the device."""
        self._api = api
        self._url = url
        self._expected = expected
        self._usage_page = usage_page
        self._report_id = report_id
        self._report_size = report_size

    def open(self) -> OpenHid:
        """Find and open the interface. Raise OpenError with the remedy."""
        found = boards(self._api, self._expected, self._usage_page)
        kind = f"HID device {self._expected}"
        if self._usage_page is not None:
            kind += f" of usage page {self._usage_page:#06x}"
        interface = choose_only(self._url, kind, found, [] if found else boards(self._api))
        with ExitStack() as undo:
            _claim(self._url, os.fsdecode(interface.path), undo)
            handle = self._open_path(interface)
            undo.callback(handle.close)
            reports = self._reports(handle)
            return OpenHid(handle, self._report(reports, Way.IN), self._report(reports, Way.OUT), undo.pop_all())

    def _open_path(self, interface: HidInterface) -> Handle:
        with LIBRARY_LOCK:
            handle = self._api.device()
            try:
                handle.open_path(interface.path)
            except OSError as error:
                raise OpenError(
                    f"{self._url}: cannot open {os.fsdecode(interface.path)}: {error}; "
                    "close the program that has it, or plug the board in again"
                ) from error
        return handle

    def _reports(self, handle: Handle) -> list[HidReport]:
        """Return the reports declared on the wanted usage pages; empty for an unreadable descriptor."""
        try:
            descriptor = bytes(handle.get_report_descriptor())
        except (OSError, AttributeError):
            return []
        pages = VENDOR_PAGES if self._usage_page is None else [self._usage_page]
        return [report for report in declared(descriptor) if report.usage_page in pages]

    def _report(self, reports: list[HidReport], way: Way) -> HidReport:
        """Return the report for one direction. Raise OpenError if the device has no such report."""
        fitting = [report for report in reports if report.way is way and self._report_id in {None, report.report_id}]
        if not fitting and reports and self._report_size is None:
            ids = sorted({f"{report.way.name.lower()} {report.report_id}" for report in reports})
            raise OpenError(
                f"{self._url}: the device has no {way.name.lower()}put report"
                f"{'' if self._report_id is None else f' with the id {self._report_id}'}; it has: {', '.join(ids)}"
            )
        report = fitting[0] if fitting else HidReport(way, self._report_id or 0, 0, _USUAL_SIZE)
        return HidReport(way, report.report_id, report.usage_page, self._report_size or report.size)


class OpenHid:
    """Open HID interface, read and written in reports."""

    def __init__(self, handle: Handle, incoming: HidReport, outgoing: HidReport, undo: ExitStack) -> None:
        """Use `handle`; `undo` closes the handle."""
        self._handle = handle
        self._incoming = incoming
        self._outgoing = outgoing
        self._undo = undo

    def read(self) -> bytes:
        """Return the next report without its id, or b"" after the time limit."""
        report_id, size = self._incoming.report_id, self._incoming.size
        try:
            report = bytes(self._handle.read(size + 1 if report_id else size, _READ_LIMIT))
        except (OSError, ValueError) as error:
            raise _disconnected(str(error)) from error
        if not report_id:
            return report
        return report[1:] if report[:1] == bytes([report_id]) else b""

    def pieces(self, frame: bytes) -> Iterator[bytes]:
        """Cut `frame` into reports."""
        return cut(frame, self._outgoing.report_id, self._outgoing.size)

    def write(self, piece: bytes) -> None:
        """Send one report; Linux waits up to 5 s for the device to take it."""
        if self._handle.write(piece) < 0:  # other return values differ between systems
            raise _disconnected(self._handle.error())

    def close(self) -> None:
        """Close the interface and release the lock for other programs."""
        self._undo.close()


def _disconnected(reason: str) -> ConnectionResetError:
    return ConnectionResetError(f"the device is gone: {reason}; is it unplugged or switched off?")


def _claim(url: str, path: str, undo: ExitStack) -> None:
    """Lock the device against other processes of servolink. Raise OpenError."""
    try:
        undo.enter_context(claim_device(path))
    except OSError as error:
        raise OpenError(f"{url}: {_reason(error, path)}") from error


def _reason(error: OSError, path: str) -> str:
    if error.errno == errno.EWOULDBLOCK:
        return f"{path} is in use by another servolink; close that program"
    if error.errno in {errno.EACCES, errno.EPERM}:
        return f"no permission for {path}; {UDEV_CURE}"
    if error.errno in {errno.ENOENT, errno.ENODEV, errno.ENXIO}:
        return f"{path} has just vanished; plug the board in again"
    return f"cannot open {path}: {error}"


def cut(frame: bytes, report_id: int, size: int) -> Iterator[bytes]:
    """Yield the reports for `frame`, each with its id in front, even id 0, and padded with zeros."""
    for start in range(0, len(frame), size):
        yield bytes([report_id]) + frame[start : start + size].ljust(size, b"\0")


class Way(IntEnum):
    """Direction of a report, as the prefix of the item in a descriptor, without the length bits."""

    IN = 0x80
    OUT = 0x90


class _ReportItem(IntEnum):
    """Other items in use, also by prefix (Device Class Definition for HID 1.11, 6.2.2)."""

    USAGE_PAGE = 0x04
    REPORT_SIZE = 0x74  # bits in one field
    REPORT_ID = 0x84
    REPORT_COUNT = 0x94  # fields
    COLLECTION = 0xA0
    END_COLLECTION = 0xC0
    PUSH = 0xA4
    POP = 0xB4
    LONG = 0xFE


@dataclass(frozen=True, slots=True)
class HidReport:
    """Report, as declared in a descriptor."""

    way: Way
    report_id: int
    usage_page: int
    size: int
    """Size in bytes, without the id in front of the report."""


@dataclass(frozen=True, slots=True)
class _Globals:
    """Global items of a descriptor, valid until given again."""

    usage_page: int = 0
    report_id: int = 0
    field_bits: int = 0
    fields: int = 0


def declared(descriptor: bytes) -> list[HidReport]:
    """Return the reports in a descriptor, in order; ignore truncated and meaningless items."""
    bits: dict[tuple[Way, int, int], int] = {}
    state, stack = _Globals(), list[_Globals]()
    depth, page = 0, 0
    for prefix, value in _items(descriptor):
        if prefix == _ReportItem.COLLECTION:
            page = page if depth else state.usage_page  # a report belongs to the usage page of the outermost collection
            depth += 1
        elif prefix == _ReportItem.END_COLLECTION:
            depth -= 1
        elif prefix in {Way.IN, Way.OUT}:
            key = Way(prefix), state.report_id, page
            bits[key] = bits.get(key, 0) + state.field_bits * state.fields
        elif prefix == _ReportItem.PUSH:
            stack.append(state)
        elif prefix == _ReportItem.POP and stack:
            state = stack.pop()
        else:
            state = _changed(state, prefix, value)
    return [
        HidReport(way, report_id, page, (count + 7) // 8) for (way, report_id, page), count in bits.items() if count
    ]


def _changed(state: _Globals, prefix: int, value: int) -> _Globals:
    match prefix:
        case _ReportItem.USAGE_PAGE:
            return replace(state, usage_page=value)
        case _ReportItem.REPORT_SIZE:
            return replace(state, field_bits=value)
        case _ReportItem.REPORT_ID:
            return replace(state, report_id=value)
        case _ReportItem.REPORT_COUNT:
            return replace(state, fields=value)
        case _:
            return state


def _items(descriptor: bytes) -> Iterator[tuple[int, int]]:
    """Yield type and tag of each item, as the prefix without the length, and the value."""
    position = 0
    while position < len(descriptor):
        prefix = descriptor[position]
        if prefix == _ReportItem.LONG:  # a reserved item, skipped by the length in the next byte
            position += 3 + (descriptor[position + 1] if position + 1 < len(descriptor) else 0)
            continue
        end = position + 1 + (0, 1, 2, 4)[prefix & 3]
        yield prefix & 0xFC, int.from_bytes(descriptor[position + 1 : end], "little")
        position = end


def from_address(address: Address) -> DeviceTransport:
    """Make the transport for `hid://VID:PID/SERIAL?report_size=64&report_id=0&usage_page=0xFF00`."""
    expected = PortIdentity.from_address(address)
    report_size = address.integer("report_size", 0, 1, 4096) or None
    report_id = address.integer("report_id", -1, 0, 255)
    usage_page = address.integer("usage_page", -1, 0, 0xFFFF)
    address.refuse_unknown()
    device = HidDevice(
        load_hidapi(),
        address.url,
        expected,
        usage_page=None if usage_page < 0 else usage_page,
        report_id=None if report_id < 0 else report_id,
        report_size=report_size,
    )
    return DeviceTransport(address.url, device)
