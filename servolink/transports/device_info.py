"""A device that may be a board, as found without opening it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar
from urllib.parse import quote

from servolink.errors import OpenError
from servolink.escaping import escape
from servolink.transports.address import Address


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """Where a board may be: `problem` says why it cannot be opened and what to do, empty if nothing is known."""

    url: str
    product: str = ""
    serial_number: str = ""
    problem: str = ""


UDEV_CURE = "`servolink doctor --print-udev` prints the udev rule that gives it, and where to put it"
"""What to do about a USB device that may not be opened, on Linux."""


def is_accessible(path: str) -> bool:
    """Tell whether this process may read and write `path`; yes if there is no such file, as on other systems."""
    try:
        os.stat(path)  # noqa: PTH116 - a port's or device's name need not be that of a file
    except PermissionError:
        return False
    except OSError:
        return True
    return os.access(path, os.R_OK | os.W_OK, effective_ids=os.access in os.supports_effective_ids)


_NUMBER = re.compile(r"(0x)?[0-9a-f]{1,4}", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class PortIdentity:
    """Vendor and product id, and serial number, empty for any; `UsbId()` is any device."""

    vendor_id: int | None = None
    product_id: int | None = None
    serial_number: str = ""

    @classmethod
    def of(cls, address: Address) -> PortIdentity:
        """Read it from `scheme://VID:PID/SERIAL`, `scheme://VID:PID` or `scheme://`."""
        serial_number = address.path.removeprefix("/")
        if not address.host and not address.port and not serial_number:
            return cls()
        if not _NUMBER.fullmatch(address.host) or not _NUMBER.fullmatch(address.port):
            raise address.refusal(
                f"must be written {address.scheme}://VID:PID or {address.scheme}://VID:PID/SERIAL, with the vendor and "
                f"product id in hexadecimal, or {address.scheme}:// for the only board there is"
            )
        return cls(int(address.host, 16), int(address.port, 16), serial_number)

    @property
    def is_any(self) -> bool:
        """Whether it names no device."""
        return self.vendor_id is None

    def fits(self, vendor_id: int, product_id: int, serial_number: str) -> bool:
        """Tell whether a device with these is meant."""
        return self.is_any or (
            (vendor_id, product_id) == (self.vendor_id, self.product_id) and self.serial_number in {"", serial_number}
        )

    def __str__(self) -> str:
        """Name it as a person reads it."""
        if self.vendor_id is None or self.product_id is None:
            return "with a vendor-defined interface"
        serial = f" with the serial number {escape(self.serial_number)!r}" if self.serial_number else ""
        return f"{self.vendor_id:04x}:{self.product_id:04x}{serial}"


def url_of(scheme: str, vendor_id: int, product_id: int, serial_number: str, option: str = "") -> str:
    """Write the address of a device."""
    serial = "/" + quote(serial_number, safe="") if serial_number else ""
    return f"{scheme}://{vendor_id:04x}:{product_id:04x}{serial}{'?' if option else ''}{option}"


class _Addressed(Protocol):
    @property
    def url(self) -> str: ...


_Found = TypeVar("_Found", bound=_Addressed)


def only(url: str, looked_for: str, found: Sequence[_Found], present: Iterable[_Addressed]) -> _Found:
    """Return the only one of `found`; OpenError says what is `present` instead."""
    if len(found) == 1:
        return found[0]
    urls = sorted(escape(each.url) for each in found)
    if len(set(urls)) < len(urls):
        raise OpenError(f"{escape(url)}: {len(urls)} devices cannot be told apart ({urls[0]}); unplug the others")
    if urls:
        raise OpenError(f"{escape(url)}: {len(urls)} devices can be the board; choose one: {', '.join(urls)}")
    others = sorted(escape(each.url) for each in present)
    what_is = f"what is there: {', '.join(others)}" if others else "nothing of that kind is there"
    raise OpenError(f"{escape(url)}: found no {looked_for}; plug the board in and switch it on; {what_is}")
