"""Search for serial ports of boards, without opening any port, and tracking of a board moved to another port."""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Iterator
from typing import Any
from urllib.parse import quote

from servolink.errors import TransportError, escape
from servolink.transports.address import Address
from servolink.transports.device_info import DeviceInfo, PortIdentity, is_accessible

_TRIES = 3
_INTERFACE = re.compile(r":[^.]+\.(\d+)$", re.ASCII)  # interface number in a location such as 1-1.4:1.0


_DRIVER = re.compile(r".*/(cu|tty)\.(usbmodem|wchusbserial|usbserial-?|SLAB_USBtoUART)")
"""Beginning of a name on macOS, where two drivers may each name the same port; what follows is the same in both."""


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
    found = set[tuple[object, ...]]()
    for port in sorted(list_ports()):
        same = port.vid, port.pid, port.serial_number, port.location, _DRIVER.sub("", port.device)
        if port.vid is not None and same not in found:
            found.add(same)
            interface = _INTERFACE.search(port.location or "")
            identity = PortIdentity(
                port.vid, port.pid, port.serial_number or "", int(interface[1]) if interface else None
            )
            yield DeviceInfo(f"serial://{quote(port.device)}", port.product or "", identity, _problem(port.device))


def _problem(device: str) -> str:
    if not os.path.exists(device) or is_accessible(device):  # noqa: PTH110 - on Windows it is only a name
        return ""
    return f"no permission for {escape(device)}; `servolink doctor` says how to get it"


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
            self._identity = PortIdentity.at(self._url, await asyncio.to_thread(candidates))

    async def url(self) -> str:
        """Return the present address of the board; for an absent or ambiguous board, the first address."""
        if self._identity is None:
            return self._url
        found = self._identity.ports_among(await asyncio.to_thread(candidates))
        if len(found) != 1 or self._is_at(found[0]):
            return self._url
        return found[0].with_options_of(self._url)

    def _is_at(self, port: DeviceInfo) -> bool:
        return Address.parse(self._url).serial_device == Address.parse(port.url).serial_device
