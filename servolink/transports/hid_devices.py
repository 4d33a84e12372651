"""Search for HID interfaces of boards in the list of hidapi, without opening any device."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from threading import Lock
from typing import Any, Protocol

from servolink.errors import TransportUnavailable, escape
from servolink.transports.device_info import ANY_DEVICE, UDEV_CURE, DeviceInfo, PortIdentity, is_accessible

VENDOR_PAGES = range(0xFF00, 0x10000)
"""Vendor-defined usage pages."""

_INSTALL = "pip install --force-reinstall hidapi"
_INPUT_USAGES = {(0x01, 0x02), (0x01, 0x06), (0x01, 0x07)}  # mouse, keyboard, keypad

LIBRARY_LOCK = Lock()
"""Lock for listing and opening devices: hidapi supports only one thread at a time."""


class Handle(Protocol):
    """Device object of hidapi."""

    def open_path(self, path: bytes, /) -> None:
        """Open the device at `path`. Raise OSError without a reason."""
        ...

    def get_report_descriptor(self) -> Sequence[int]:
        """Return the report descriptor of the device; from hidapi 0.14 on."""
        ...

    def read(self, max_length: int, timeout_ms: int, /) -> Sequence[int]:
        """Return a report, or nothing after `timeout_ms`; 0 waits forever. Raise OSError for an unplugged device."""
        ...

    def write(self, report: bytes, /) -> int:
        """Send a report with its id in front; return a negative number for a failure."""
        ...

    def error(self) -> str:
        """Return the error text of the last failed call."""
        ...

    def close(self) -> None:
        """Close the device; must not be called during another call."""
        ...


class HidApi(Protocol):
    """Used part of the module of hidapi."""

    def enumerate(self) -> list[dict[str, Any]]:
        """Return every outermost collection of every device."""
        ...

    def device(self) -> Handle:
        """Return an unopened device object."""
        ...


def load_hidapi() -> HidApi:
    """Import hidapi. Raise TransportUnavailable, with the package to install or to replace."""
    reason = "hidapi is not installed"
    # On Linux the module `hid` detaches the device from the kernel and knows no usage pages.
    for name in ("hidraw", "hid") if sys.platform == "linux" else ("hid",):
        try:
            module: Any = import_module(name)
        except Exception as error:  # noqa: BLE001 - the package of another maker fails in ways of its own
            reason = f"hidapi cannot be loaded: {type(error).__name__}: {error}"
        else:
            if hasattr(module, "device") and hasattr(module, "enumerate"):
                return module  # type: ignore[no-any-return]  # checked above
    if _is_package("hid"):
        raise TransportUnavailable(
            f"hid:// needs the package hidapi, but the module `hid` belongs to another package, named hid; "
            f"try: pip uninstall hid; {_INSTALL}"
        )
    raise TransportUnavailable(f"hid:// cannot be used: {reason}; try: {_INSTALL}")


def _is_package(name: str) -> bool:
    """Return whether a module is a package, with a folder; the module of hidapi is a single file."""
    try:
        spec = find_spec(name)
    except (ValueError, ImportError):  # in sys.modules without an origin, or kept from being imported
        return False
    return spec is not None and spec.submodule_search_locations is not None


@dataclass(frozen=True, slots=True)
class HidInterface:
    """HID interface; `usages` are usage page and usage of each outermost collection."""

    path: bytes
    identity: PortIdentity
    product: str
    usages: tuple[tuple[int, int], ...]
    exclusive: bool = True  # whether no other interface of the device can be a board

    @property
    def url(self) -> str:
        """Address of the interface, with the usage page if the device has several such interfaces."""
        return self.identity.url("hid", "" if self.exclusive else f"usage_page={self.usages[0][0]:#06x}")

    @property
    def is_input(self) -> bool:
        """Whether the interface belongs to a keyboard or a mouse."""
        return not _INPUT_USAGES.isdisjoint(self.usages)

    @property
    def problem(self) -> str:
        """Reason why the interface cannot be opened, with the remedy; empty without a known problem."""
        path = os.fsdecode(self.path)
        return "" if is_accessible(path) else f"no permission for {escape(path)}; {UDEV_CURE}"

    def has_page(self, expected: int | None) -> bool:
        """Return whether the interface has the usage page `expected`, for None any vendor-defined page."""
        return any(page == expected if expected is not None else page in VENDOR_PAGES for page, _ in self.usages)


def interfaces(api: HidApi) -> list[HidInterface]:
    """Return all HID interfaces of all devices."""
    with LIBRARY_LOCK:
        entries = api.enumerate()
    found: dict[bytes, HidInterface] = {}
    for entry in entries:  # one entry for each outermost collection
        usage = int(entry["usage_page"]), int(entry["usage"])
        path = bytes(entry["path"])
        if path in found:
            found[path] = replace(found[path], usages=(*found[path].usages, usage))
        else:
            number = entry["interface_number"]
            identity = PortIdentity(
                entry["vendor_id"],
                entry["product_id"],
                entry["serial_number"] or "",
                number if number >= 0 else None,  # hidapi returns -1 for a number unknown to the system
            )
            found[path] = HidInterface(path, identity, entry["product_string"] or "", (usage,))
    return list(found.values())


def boards(api: HidApi, expected: PortIdentity = ANY_DEVICE, usage_page: int | None = None) -> list[HidInterface]:
    """Return the fitting interfaces of possible boards; keyboards and mice only if `expected` has their ids."""
    everything = interfaces(api)
    inputs = {each.identity.device for each in everything if each.is_input}
    found = [
        each
        for each in everything
        if expected.fits(each.identity)
        and each.has_page(usage_page)
        and not each.is_input
        and not (expected.is_any and each.identity.device in inputs)
    ]
    siblings = Counter(each.identity.device for each in found)
    return [replace(each, exclusive=siblings[each.identity.device] == 1) for each in found]


def candidates() -> list[DeviceInfo]:
    """Return the possible boards on HID. Raise TransportUnavailable, with the package to install."""
    return [DeviceInfo(each.url, each.product, each.identity, each.problem) for each in boards(load_hidapi())]
