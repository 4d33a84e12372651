"""Possible boards, found without opening any device, and USB identities to find a device again."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from typing import Protocol, TypeVar
from urllib.parse import quote as percent_encoded

from msgspec import Struct
from msgspec.structs import replace

from servolink.errors import OpenError, Reason, quote
from servolink.transports.address import Address

UDEV_CURE = "`servolink doctor --print-udev` prints the udev rule for this permission, and where to put the rule"
"""Remedy on Linux for a USB device without permission for the user."""

_NUMBER = re.compile(r"(0x)?[0-9a-f]{1,4}", re.ASCII | re.IGNORECASE)


class PortIdentity(Struct, frozen=True):
    """Identity of a USB device, the same on every port; None and "" mean unknown or, in a search, any."""

    vendor_id: int | None = None
    product_id: int | None = None
    serial_number: str = ""
    interface: int | None = None
    """Interface number, different for each port of a device with several ports."""

    @classmethod
    def from_address(cls, address: Address) -> PortIdentity:
        """Return the identity in `scheme://VID:PID/SERIAL`, `scheme://VID:PID` or `scheme://`."""
        serial_number = address.path.removeprefix("/")
        if not address.host and not address.port and not serial_number:
            return cls()
        if not _NUMBER.fullmatch(address.host) or not _NUMBER.fullmatch(address.port):
            raise address.refusal(
                f"must be written {address.scheme}://VID:PID or {address.scheme}://VID:PID/SERIAL, with the vendor and "
                f"product id in hexadecimal, or {address.scheme}:// for the only board there is"
            )
        return cls(int(address.host, 16), int(address.port, 16), serial_number)

    @classmethod
    def at(cls, url: str, devices: Iterable[DeviceInfo]) -> PortIdentity | None:
        """Return the identity of the serial port at `url`; None without a serial number."""
        if not (port := Address.parse(url).serial_device):
            return None
        at_url = (device.identity for device in devices if Address.parse(device.url).serial_device == port)
        return next((identity for identity in at_url if identity.serial_number), None)

    @property
    def device(self) -> PortIdentity:
        """Identity of the whole device, without the interface number."""
        return replace(self, interface=None)

    @property
    def is_any(self) -> bool:
        """Whether the identity fits every device."""
        return self.vendor_id is None and not self.serial_number

    def fits(self, found: PortIdentity) -> bool:
        """Return whether `found` has all known parts of this identity."""
        return (
            self.vendor_id in {None, found.vendor_id}
            and self.product_id in {None, found.product_id}
            and self.serial_number in {"", found.serial_number}
            and self.interface in {None, found.interface}
        )

    def ports_among(self, devices: Iterable[DeviceInfo]) -> list[DeviceInfo]:
        """Return the serial ports with this identity."""
        return [device for device in devices if device.url.startswith("serial://") and self.fits(device.identity)]

    def url(self, scheme: str, option: str = "") -> str:
        """Return the address of the device, with `option` as the only option."""
        serial_number = "/" + percent_encoded(self.serial_number, safe="") if self.serial_number else ""
        return f"{scheme}://{self._ids}{serial_number}{'?' if option else ''}{option}"

    def __str__(self) -> str:
        """Return the identity as text for people, such as `0403:6001`."""
        if self.is_any:
            return "with a vendor-defined interface"
        return self._ids + (f" with the serial number {quote(self.serial_number)}" if self.serial_number else "")

    @property
    def _ids(self) -> str:
        return f"{self.vendor_id or 0:04x}:{self.product_id or 0:04x}"


ANY_DEVICE = PortIdentity()


class DeviceInfo(Struct, frozen=True):
    """Address of a possible board, with facts known without opening the device."""

    url: str
    product: str = ""
    """Product name reported by the device; empty if missing."""
    identity: PortIdentity = ANY_DEVICE
    """USB identity of the device, to find the device again; unknown for other devices."""
    problem: str = ""
    """Reason why the device cannot be opened, with the remedy; empty without a known problem."""
    shares: str = ""
    """Address of the board shared by a hub; empty for other devices."""

    @property
    def serial_number(self) -> str:
        """Serial number of the USB device; empty if missing."""
        return self.identity.serial_number

    def with_options_of(self, url: str) -> str:
        """Return the address of the device with the options of `url`."""
        place, options = self.url.partition("?")[0], url.partition("?")[2]
        return f"{place}?{options}" if options else self.url


def is_accessible(path: str) -> bool:
    """Return whether the process may read and write `path`; True for a missing file, as on other systems."""
    try:
        os.stat(path)  # noqa: PTH116 - the name of a port or device need not be that of a file
    except PermissionError:
        return False
    except OSError:
        return True
    return os.access(path, os.R_OK | os.W_OK, effective_ids=os.access in os.supports_effective_ids)


class _Addressed(Protocol):
    @property
    def url(self) -> str: ...


_Found = TypeVar("_Found", bound=_Addressed)


def choose_only(url: str, expected: str, found: Sequence[_Found], present: Iterable[_Addressed]) -> _Found:
    """Return the only device in `found`. Raise OpenError for several, or for none, with the `present` devices."""
    if len(found) == 1:
        return found[0]
    urls = sorted(each.url for each in found)
    if len(set(urls)) < len(urls):
        raise OpenError(f"{url}: {len(urls)} devices cannot be told apart ({urls[0]}); unplug the others")
    if urls:
        raise OpenError(f"{url}: {len(urls)} devices can be the board; choose among: {', '.join(urls)}")
    others = ", ".join(sorted(each.url for each in present))
    present_text = f"these are here: {others}" if others else "nothing of that kind is here"
    text = f"{url}: found no {expected}; plug the board in and switch it on; {present_text}"
    raise OpenError(text, reason=Reason.NOT_FOUND)
