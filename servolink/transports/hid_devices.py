"""Which HID devices can be boards, as hidapi lists them without opening any."""

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

from servolink.errors import TransportUnavailable
from servolink.printable import printable
from servolink.transports.candidate import Candidate
from servolink.transports.permission import UDEV_CURE, may_use
from servolink.transports.reports import VENDOR_PAGES
from servolink.transports.usb_id import UsbId, url_of

_INSTALL = "pip install --force-reinstall hidapi"
_INPUT_USAGES = {(0x01, 0x02), (0x01, 0x06), (0x01, 0x07)}  # mouse, keyboard, keypad

LIBRARY_LOCK = Lock()
"""Held while hidapi lists or opens, which it can do for one thread at a time only."""


class Handle(Protocol):
    """A device of hidapi."""

    def open_path(self, path: bytes, /) -> None:
        """Open it; an OSError says no more than that it failed."""
        ...

    def get_report_descriptor(self) -> Sequence[int]:
        """Return its report descriptor, from hidapi 0.14 on."""
        ...

    def read(self, max_length: int, timeout_ms: int, /) -> Sequence[int]:
        """Return a report, or nothing once the time is over; OSError once it is gone. 0 ms is for ever."""
        ...

    def write(self, report: bytes, /) -> int:
        """Send a report with its id in front; negative if it failed."""
        ...

    def error(self) -> str:
        """Say why."""
        ...

    def close(self) -> None:
        """Close it; never during another call."""
        ...


class HidApi(Protocol):
    """The module of hidapi, as far as it is used."""

    def enumerate(self) -> list[dict[str, Any]]:
        """List every outermost collection of every device."""
        ...

    def device(self) -> Handle:
        """Make an unopened device."""
        ...


def load() -> HidApi:
    """Import hidapi; TransportUnavailable says what to install, or to replace."""
    reason = "hidapi is not installed"
    # On Linux the module `hid` takes the device away from the kernel and knows no usage pages.
    for name in ("hidraw", "hid") if sys.platform == "linux" else ("hid",):
        try:
            module: Any = import_module(name)
        except Exception as error:  # noqa: BLE001 - the package of another maker fails in ways of its own
            reason = printable(f"hidapi cannot be loaded: {type(error).__name__}: {error}")
        else:
            if hasattr(module, "device") and hasattr(module, "enumerate"):
                return module  # type: ignore[no-any-return]
    if _is_package("hid"):
        raise TransportUnavailable(
            f"hid:// needs the package hidapi, but the module `hid` is that of another package, named hid; "
            f"try: pip uninstall hid; {_INSTALL}"
        )
    raise TransportUnavailable(f"hid:// cannot be used: {reason}; try: {_INSTALL}")


def _is_package(name: str) -> bool:
    """Tell whether a module is a folder, which hidapi's never is."""
    try:
        spec = find_spec(name)
    except ValueError:  # it is in sys.modules without saying where from
        return False
    return spec is not None and spec.submodule_search_locations is not None


@dataclass(frozen=True, slots=True)
class HidInterface:
    """An HID interface; `usages` are usage page and usage of each of its outermost collections."""

    path: bytes
    vendor_id: int
    product_id: int
    serial_number: str
    manufacturer: str
    product: str
    interface_number: int
    usages: tuple[tuple[int, int], ...]
    alone: bool = True  # whether no other one of its device can be a board

    @property
    def url(self) -> str:
        """Its address, with the usage page where that tells it from others of its device."""
        option = "" if self.alone else f"usage_page={self.usages[0][0]:#06x}"
        return url_of("hid", self.vendor_id, self.product_id, self.serial_number, option)

    @property
    def identity(self) -> tuple[int, int, str]:
        """Vendor id, product id and serial number."""
        return self.vendor_id, self.product_id, self.serial_number

    @property
    def is_input(self) -> bool:
        """Whether it is a keyboard or a mouse."""
        return not _INPUT_USAGES.isdisjoint(self.usages)

    @property
    def problem(self) -> str:
        """Why it cannot be opened, and what to do; empty if nothing is known."""
        path = os.fsdecode(self.path)
        return "" if may_use(path) else f"no permission for {printable(path)}; {UDEV_CURE}"

    def has_page(self, wanted: int | None) -> bool:
        """Tell whether it has the usage page `wanted`, or for None one that is the maker's own."""
        return any(page == wanted if wanted is not None else page in VENDOR_PAGES for page, _ in self.usages)


def interfaces(api: HidApi) -> list[HidInterface]:
    """List every HID interface."""
    with LIBRARY_LOCK:
        entries = api.enumerate()
    found: dict[bytes, HidInterface] = {}
    for entry in entries:  # one for each outermost collection
        usage = int(entry["usage_page"]), int(entry["usage"])
        path = bytes(entry["path"])
        if path in found:
            found[path] = replace(found[path], usages=(*found[path].usages, usage))
        else:
            found[path] = HidInterface(
                path,
                entry["vendor_id"],
                entry["product_id"],
                entry["serial_number"] or "",
                entry["manufacturer_string"] or "",
                entry["product_string"] or "",
                entry["interface_number"],
                (usage,),
            )
    return list(found.values())


def boards(api: HidApi, wanted: UsbId | None = None, usage_page: int | None = None) -> list[HidInterface]:
    """List what can be a board and fits; a keyboard's or mouse's other interfaces only when its id is given."""
    everything = interfaces(api)
    wanted = wanted or UsbId()
    inputs = {each.identity for each in everything if each.is_input}
    found = [
        each
        for each in everything
        if wanted.fits(*each.identity)
        and each.has_page(usage_page)
        and not each.is_input
        and not (wanted.is_any and each.identity in inputs)
    ]
    siblings = Counter(each.identity for each in found)
    return [replace(each, alone=siblings[each.identity] == 1) for each in found]


def candidates() -> list[Candidate]:
    """List the HID devices that can be boards; TransportUnavailable says what to install."""
    return [Candidate(each.url, each.product, each.serial_number, each.problem) for each in boards(load())]
