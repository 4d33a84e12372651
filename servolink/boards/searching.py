"""Search for boards without opening any port, and choice among the boards found."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterable, Sequence
from importlib import import_module
from typing import NamedTuple

from msgspec.structs import replace

from servolink.errors import InvalidAddress, OpenError, Reason, SeveralBoards, TransportError
from servolink.transports import Address, DeviceInfo, PlugIn, PortIdentity

_KINDS = (
    "servolink.transports.serial_ports",
    "servolink.transports.hid_devices",
    "servolink.transports.usb_devices",
    "servolink.transports.page_ports",
    "servolink.boards.announcements",
    "servolink.boards.hubs",
)
"""Modules with a function `candidates`, in order of preference for a board found by several."""
_MODULE_OF = dict(zip(("serial", "hid", "usb"), _KINDS, strict=False))
"""Modules for USB devices, by the scheme of their addresses."""


class SearchResult(NamedTuple):
    """The result of a search."""

    devices: list[DeviceInfo]
    failures: list[TransportError]
    """Errors of the plug-ins of other packages."""


async def discover() -> list[DeviceInfo]:
    """Return possible boards: devices, and the virtual and shared boards on the local machine.

    No port is opened. The result includes devices that cannot be opened: `problem` gives cause and remedy. A device
    with several ways of access is included once for each. A missing library or a broken plug-in hides its devices: see
    `servolink doctor`.
    """
    return await asyncio.to_thread(search)


def search() -> list[DeviceInfo]:
    """Return the result of `discover`, and block meanwhile."""
    return find_devices().devices


def find_devices() -> SearchResult:
    """Search with the built-in modules, then with the plug-ins of other packages, whose errors are collected."""
    found = SearchResult([device for kind in _KINDS for device in _find_kind(kind)], [])
    for plug_in in PlugIn.all_in(PlugIn.DISCOVERY):
        try:
            found.devices.extend(_find_with(plug_in))
        except TransportError as error:
            found.failures.append(error)
    return found._replace(devices=_through_hubs(found.devices))


def _through_hubs(devices: list[DeviceInfo]) -> list[DeviceInfo]:
    """Return the devices, each device shared by a hub with a `problem` that refers to the hub."""
    hubs = [device for device in devices if device.shares]
    return [
        next(
            (
                replace(device, problem=f"{hub.product}: use {hub.url}")
                for hub in hubs
                if not device.shares and is_same_place(device.url, hub.shares)
            ),
            device,
        )
        for device in devices
    ]


def is_same_place(one: str, other: str) -> bool:
    """Return whether two addresses differ at most in options of the connection, such as the byte order."""
    try:
        first, second = Address.parse(one), Address.parse(other)
    except InvalidAddress:  # an alias edited by hand, with an invalid address
        return False
    return _place(first) == _place(second) and (bool(first.serial_device) or first.options == second.options)


def identity_of(url: str) -> PortIdentity | None:
    """Return the USB identity of the port at `url`; None for an absent port or a port without identity. Blocks."""
    address = Address.parse(url)
    if address.scheme not in _MODULE_OF:
        return None
    for device in _find_kind(_MODULE_OF[address.scheme]):
        if _place(Address.parse(device.url)) == _place(address):
            return device.identity
    return None


def _place(address: Address) -> object:
    """Return a value equal for all addresses of the same port or host."""
    return address.serial_device or (address.scheme, address.host, address.port, address.path)


def _find_kind(module: str) -> list[DeviceInfo]:
    """Return the candidates of a built-in module; nothing if the module needs a missing library."""
    try:
        return list(import_module(module).candidates())
    except Exception:  # noqa: BLE001 - a library that is missing or broken, in ways of its own
        return []


def _find_with(plug_in: PlugIn) -> list[DeviceInfo]:
    """Return the candidates of a plug-in. Raise TransportError for a broken plug-in."""
    with plug_in.blamed():
        devices = list(plug_in.load()())
    for device in devices:
        if not isinstance(device, DeviceInfo):
            raise plug_in.broken(f"it returned {type(device).__name__} instead of a DeviceInfo")
        try:
            Address.parse(device.url)  # raises now what every user of the result would meet
        except InvalidAddress as error:
            raise plug_in.broken(str(error)) from error
    return devices


NO_BOARD_FOUND = (
    "no board was found; plug a board in and switch it on, or name a board (--board or SERVOLINK_BOARD), as in "
    "serial:///dev/ttyACM0, tcp://192.168.1.20:9000 or virtual://; `servolink doctor` looks for the reason"
)


def boards(candidates: Iterable[DeviceInfo]) -> list[DeviceInfo]:
    """Return one candidate for each board: its hub, else the first candidate without a problem, else the first.

    Candidates with the same identity are the same board with several ways of access, unless two have the same way:
    makers of cheap adapters give all adapters the same serial number.
    """
    candidates = list(candidates)
    uses = Counter((scheme(candidate), candidate.identity.device) for candidate in candidates)
    ambiguous = {identity for (_, identity), count in uses.items() if count > 1 or not identity.serial_number}
    shared = [candidate.shares for candidate in candidates if candidate.shares]
    groups: dict[object, list[DeviceInfo]] = {}
    for candidate in candidates:
        if not candidate.shares and any(is_same_place(candidate.url, place) for place in shared):
            continue  # represented by its hub, also if neither has an identity
        identity = candidate.identity.device
        groups.setdefault(candidate if identity in ambiguous else identity, []).append(candidate)
    return [min(ways, key=lambda way: (not way.shares, bool(way.problem))) for ways in groups.values()]


def only(candidates: Sequence[DeviceInfo]) -> str:
    """Return the address of the only board, or of the only board without a problem.

    Raise SeveralBoards with all addresses, or OpenError if no board can be opened.
    """
    found = boards(candidates)
    usable = [board for board in found if not board.problem]
    if len(usable) == 1:
        return usable[0].url
    if not found:
        raise OpenError(NO_BOARD_FOUND, reason=Reason.NOT_FOUND)
    if len(found) == 1:
        raise OpenError(f"{found[0].url}: {found[0].problem}")
    raise SeveralBoards(f"{len(found)} boards are here; name one of {', '.join(board.url for board in found)}")


def scheme(candidate: DeviceInfo) -> str:
    """Return the scheme in the address of a candidate."""
    return candidate.url.partition("://")[0]
