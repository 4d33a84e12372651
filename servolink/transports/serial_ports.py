"""Search for serial ports of boards, without opening any port, and tracking of a board moved to another port."""

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
_INTERFACE = re.compile(r":[^.]+\.(\d+)$", re.ASCII)  # interface number in a location such as 1-1.4:1.0


def list_ports() -> list[Any]:
    """Return all serial ports, as described by pyserial.

    For a device unplugged during the search pyserial raises various errors, such as a TypeError; the next attempt does
    not find the device.
    """
    from serial.tools import list_ports as pyserial  # type: ignore[import-untyped] # other kinds need no pyserial

    for _ in range(_TRIES):
        try:
            return list(pyserial.comports())
        except Exception:  # noqa: BLE001, S112 - a caller could do nothing but ask again
            continue
    return []


def candidates() -> list[DeviceInfo]:
    """Return the serial ports on USB. Other ports, such as modems or the pins of a Raspberry Pi, must be named."""
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
    """Return the identity of the serial port at `url`; None without a serial number."""
    if not (port := Address.parse(url).serial_device):
        return None
    at_url = (device.identity for device in devices if Address.parse(device.url).serial_device == port)
    return next((identity for identity in at_url if identity.serial_number), None)


def ports_of(identity: PortIdentity, devices: Iterable[DeviceInfo]) -> list[DeviceInfo]:
    """Return the serial ports with the USB identity `identity`."""
    return [device for device in devices if device.url.startswith("serial://") and identity.fits(device.identity)]


def move(url: str, port: DeviceInfo) -> str:
    """Return the address of `port` with the options of `url`."""
    place, options = port.url.partition("?")[0], url.partition("?")[2]
    return f"{place}?{options}" if options else port.url


class PortTracker:
    """Tracker of the board at an address: a serial port with a USB serial number may get another name."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._identity: PortIdentity | None = None

    async def learn(self) -> None:
        """Store the identity of the board now at the address."""
        try:
            is_serial = bool(Address.parse(self._url).serial_device)
        except TransportError:
            return  # opening the wrong address reports the error
        if is_serial:
            self._identity = identity_at(self._url, await asyncio.to_thread(candidates))

    async def url(self) -> str:
        """Return the present address of the board; for an absent or ambiguous board, the first address."""
        if self._identity is None:
            return self._url
        found = ports_of(self._identity, await asyncio.to_thread(candidates))
        if len(found) != 1 or self._is_at(found[0]):
            return self._url
        return move(self._url, found[0])

    def _is_at(self, port: DeviceInfo) -> bool:
        return Address.parse(self._url).serial_device == Address.parse(port.url).serial_device
