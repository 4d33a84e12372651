"""Which HID devices can be boards, as hidapi lists them without opening any."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from importlib import import_module
from importlib.util import find_spec
from threading import Lock
from typing import Any, Protocol

from servolink.errors import TransportUnavailable
from servolink.escaping import escape
from servolink.transports.device_info import UDEV_CURE, DeviceInfo, PortIdentity, is_accessible, url_of

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
            reason = escape(f"hidapi cannot be loaded: {type(error).__name__}: {error}")
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
        return "" if is_accessible(path) else f"no permission for {escape(path)}; {UDEV_CURE}"

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


def boards(api: HidApi, wanted: PortIdentity | None = None, usage_page: int | None = None) -> list[HidInterface]:
    """List what can be a board and fits; a keyboard's or mouse's other interfaces only when its id is given."""
    everything = interfaces(api)
    wanted = wanted or PortIdentity()
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


def candidates() -> list[DeviceInfo]:
    """List the HID devices that can be boards; TransportUnavailable says what to install."""
    return [DeviceInfo(each.url, each.product, each.serial_number, each.problem) for each in boards(load())]


VENDOR_PAGES = range(0xFF00, 0x10000)
"""The usage pages that a maker may use for anything."""


class Way(IntEnum):
    """Which way a report goes; the number is its item's prefix in a descriptor, without the length."""

    IN = 0x80
    OUT = 0x90


@dataclass(frozen=True, slots=True)
class Report:
    """A report as declared: its size is in bytes, without the id that precedes it unless the id is 0."""

    way: Way
    report_id: int
    usage_page: int
    size: int


@dataclass(frozen=True, slots=True)
class _Globals:
    """The items that hold until they are given again."""

    usage_page: int = 0
    report_id: int = 0
    field_bits: int = 0
    fields: int = 0


def declared(descriptor: bytes) -> list[Report]:
    """Return the reports of a descriptor, in its order; what is cut off or makes no sense adds nothing."""
    bits: dict[tuple[Way, int, int], int] = {}
    state, stack = _Globals(), list[_Globals]()
    depth, page = 0, 0
    for prefix, value in _items(descriptor):
        if prefix == 0xA0:
            page = page if depth else state.usage_page  # a report belongs to the outermost collection's page
            depth += 1
        elif prefix == 0xC0:
            depth -= 1
        elif prefix in {Way.IN, Way.OUT}:
            key = Way(prefix), state.report_id, page
            bits[key] = bits.get(key, 0) + state.field_bits * state.fields
        elif prefix == 0xA4:
            stack.append(state)
        elif prefix == 0xB4 and stack:
            state = stack.pop()
        else:
            state = _changed(state, prefix, value)
    return [Report(way, report_id, page, (count + 7) // 8) for (way, report_id, page), count in bits.items() if count]


def _changed(state: _Globals, prefix: int, value: int) -> _Globals:
    match prefix:
        case 0x04:
            return replace(state, usage_page=value)
        case 0x74:
            return replace(state, field_bits=value)
        case 0x84:
            return replace(state, report_id=value)
        case 0x94:
            return replace(state, fields=value)
        case _:
            return state


def _items(descriptor: bytes) -> Iterator[tuple[int, int]]:
    """Yield type and tag of each item, as its prefix without the length, and its value."""
    position = 0
    while position < len(descriptor):
        prefix = descriptor[position]
        if prefix == 0xFE:  # a long item, which means nothing yet: its length follows
            position += 3 + (descriptor[position + 1] if position + 1 < len(descriptor) else 0)
            continue
        end = position + 1 + (0, 1, 2, 4)[prefix & 3]
        yield prefix & 0xFC, int.from_bytes(descriptor[position + 1 : end], "little")
        position = end
