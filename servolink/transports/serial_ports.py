"""The serial ports that can be boards, as the system lists them without opening any; and a board that moves."""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Iterable, Iterator
from typing import Any
from urllib.parse import quote

from servolink.errors import TransportError
from servolink.escaping import escape
from servolink.transports.address import Address
from servolink.transports.device_info import DeviceInfo, PortIdentity, is_accessible

_TRIES = 3
_INTERFACE = re.compile(r":[^.]+\.(\d+)$", re.ASCII)  # in a location such as 1-1.4:1.0


def list_ports() -> list[Any]:
    """Return all serial ports, as pyserial describes them.

    While a device vanishes pyserial fails in ways of its own, for example with a TypeError; the next try is without
    that device.
    """
    from serial.tools import list_ports as pyserial  # type: ignore[import-untyped] # other kinds do without pyserial

    for _ in range(_TRIES):
        try:
            return list(pyserial.comports())
        except Exception:  # noqa: BLE001, S112 - a caller could do nothing but ask again
            continue
    return []


def candidates() -> list[DeviceInfo]:
    """Return the serial ports on USB; others, such as a modem's or a Raspberry Pi's pins, must be named by the user."""
    return list(_candidates())


def _candidates() -> Iterator[DeviceInfo]:
    for port in sorted(list_ports()):
        if port.vid is not None:
            interface = _INTERFACE.search(port.location or "")
            identity = PortIdentity(
                port.vid, port.pid, port.serial_number or "", int(interface[1]) if interface else None
            )
            yield DeviceInfo(f"serial://{quote(port.device)}", port.product or "", identity, _problem(port.device))


def _problem(device: str) -> str:
    if not os.path.exists(device) or is_accessible(device):  # noqa: PTH110 - on Windows it is only a name
        return ""
    return f"no permission for {escape(device)}; `servolink doctor` says how to get it"


def identity_at(url: str, devices: Iterable[DeviceInfo]) -> PortIdentity | None:
    """Return the identity of the serial port at `url`; None if it has no serial number to find it again by."""
    if not (wanted := Address.parse(url).serial_device):
        return None
    at_url = (device.identity for device in devices if Address.parse(device.url).serial_device == wanted)
    return next((identity for identity in at_url if identity.serial_number), None)


def ports_of(identity: PortIdentity, devices: Iterable[DeviceInfo]) -> list[DeviceInfo]:
    """Return the serial ports that have `identity`."""
    return [device for device in devices if device.url.startswith("serial://") and identity.fits(device.identity)]


def move(url: str, port: DeviceInfo) -> str:
    """Return the address of `port` with the options of `url`."""
    place, options = port.url.partition("?")[0], url.partition("?")[2]
    return f"{place}?{options}" if options else port.url


class PortTracker:
    """Follows the board behind one address; only a serial port with a USB serial number ever moves."""

    def __init__(self, url: str) -> None:
        """Follow the board at `url`."""
        self._url = url
        self._identity: PortIdentity | None = None

    async def learn(self) -> None:
        """Remember which board is at the address now."""
        try:
            is_serial = bool(Address.parse(self._url).serial_device)
        except TransportError:
            return  # opening the address reports what is wrong with it
        if is_serial:
            self._identity = identity_at(self._url, await asyncio.to_thread(candidates))

    async def url(self) -> str:
        """Return where the board is now; the first address if it is not here or cannot be told from another."""
        if self._identity is None:
            return self._url
        found = ports_of(self._identity, await asyncio.to_thread(candidates))
        if len(found) != 1 or self._is_at(found[0]):
            return self._url
        return move(self._url, found[0])

    def _is_at(self, port: DeviceInfo) -> bool:
        return Address.parse(self._url).serial_device == Address.parse(port.url).serial_device
