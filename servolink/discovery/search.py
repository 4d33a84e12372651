"""The search for boards, which opens nothing, and the choice among those it finds."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib import import_module
from typing import NamedTuple

from servolink.errors import InvalidAddress, OpenError, SeveralBoards, TransportError
from servolink.transports.address import Address
from servolink.transports.device_info import DeviceInfo, PortIdentity
from servolink.transports.registry import DISCOVERY, PlugIn, plug_ins

_KINDS = (
    "servolink.transports.serial_ports",
    "servolink.transports.hid_devices",
    "servolink.transports.usb_devices",
    "servolink.discovery.announcements",
    "servolink.discovery.hubs",
)
"""The modules whose `candidates` find boards, the best way to a board first."""
_MODULE_OF = dict(zip(("serial", "hid", "usb"), _KINDS, strict=False))
"""The first ones, by the scheme of the addresses that they find."""


class SearchResult(NamedTuple):
    """The result of a search."""

    devices: list[DeviceInfo]
    failures: list[TransportError]
    """Why the plug-ins of other packages found nothing."""


async def discover() -> list[DeviceInfo]:
    """Return the devices that may be boards, and the virtual and shared boards on this machine.

    Nothing is opened. A device that cannot be opened is included; its `problem` says why and what to do. One that is
    reached in several ways is included once for each. A missing library or a broken plug-in hides the devices that
    only it finds: see `servolink doctor`.
    """
    return await asyncio.to_thread(search)


def search() -> list[DeviceInfo]:
    """Return the result of `discover`, but block."""
    return find_devices().devices


def find_devices() -> SearchResult:
    """Search with our own kinds, then with the plug-ins of other packages, which may fail."""
    found = SearchResult([device for kind in _KINDS for device in _find_kind(kind)], [])
    for plug_in in plug_ins(DISCOVERY):
        try:
            found.devices.extend(_find_with(plug_in))
        except TransportError as error:
            found.failures.append(error)
    return found._replace(devices=_through_hubs(found.devices))


def _through_hubs(devices: list[DeviceInfo]) -> list[DeviceInfo]:
    """Return the devices, with a problem for those that a hub shares: they are used through it."""
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
    except InvalidAddress:  # written by hand, and useless
        return False
    return _place(first) == _place(second) and (bool(first.serial_device) or first.options == second.options)


def identity_of(url: str) -> PortIdentity | None:
    """Return the USB identity of the port at `url`; None for an absent port, or one without identity. Blocks."""
    address = Address.parse(url)
    if address.scheme not in _MODULE_OF:
        return None
    for device in _find_kind(_MODULE_OF[address.scheme]):
        if _place(Address.parse(device.url)) == _place(address):
            return device.identity
    return None


def _place(address: Address) -> object:
    return address.serial_device or (address.scheme, address.host, address.port, address.path)


def _find_kind(module: str) -> list[DeviceInfo]:
    try:
        return list(import_module(module).candidates())
    except Exception:  # noqa: BLE001 - a library that is missing or broken, in ways of its own
        return []


def _find_with(plug_in: PlugIn) -> list[DeviceInfo]:
    with plug_in.blamed():
        devices = list(plug_in.load()())
    for device in devices:
        if not isinstance(device, DeviceInfo):
            raise plug_in.broken(f"it returned {type(device).__name__} instead of a DeviceInfo")
        try:
            Address.parse(device.url)  # all users of the result parse it
        except InvalidAddress as error:
            raise plug_in.broken(str(error)) from error
    return devices


NONE_HERE = (
    "no board was found; plug it in and switch it on, or name one (with --board or SERVOLINK_BOARD in a shell), as in "
    "serial:///dev/ttyACM0, tcp://192.168.1.20:9000 or virtual://; `servolink doctor` looks for the reason"
)


def boards(candidates: Iterable[DeviceInfo]) -> list[DeviceInfo]:
    """Return one candidate for each board: a hub that shares it, the first that can be opened, or else the first.

    Candidates with one identity are one board that is reached in several ways, unless two are reached in the same
    way: makers of cheap adapters give all of them one serial number.
    """
    candidates = list(candidates)
    uses = Counter((scheme(candidate), candidate.identity.device) for candidate in candidates)
    ambiguous = {identity for (_, identity), count in uses.items() if count > 1 or not identity.serial_number}
    shared = [candidate.shares for candidate in candidates if candidate.shares]
    groups: dict[object, list[DeviceInfo]] = {}
    for candidate in candidates:
        if not candidate.shares and any(is_same_place(candidate.url, place) for place in shared):
            continue  # its hub stands for it, also where neither has an identity
        identity = candidate.identity.device
        groups.setdefault(candidate if identity in ambiguous else identity, []).append(candidate)
    return [min(ways, key=lambda way: (not way.shares, bool(way.problem))) for ways in groups.values()]


def only(candidates: Sequence[DeviceInfo]) -> str:
    """Return the address of the only board, or of the only one that can be opened.

    Raise SeveralBoards, which names them all, or OpenError if there is none that can be opened.
    """
    found = boards(candidates)
    usable = [board for board in found if not board.problem]
    if len(usable) == 1:
        return usable[0].url
    if not found:
        raise OpenError(NONE_HERE)
    if len(found) == 1:
        raise OpenError(f"{found[0].url}: {found[0].problem}")
    raise SeveralBoards(f"{len(found)} boards are here; name one of {', '.join(board.url for board in found)}")


def scheme(candidate: DeviceInfo) -> str:
    """Return the scheme of its address."""
    return candidate.url.partition("://")[0]
