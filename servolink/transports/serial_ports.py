"""Which serial ports can be boards: those on USB, as the system lists them without opening any."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator
from typing import Any
from urllib.parse import quote

from servolink.errors import TransportError
from servolink.escaping import escape
from servolink.transports.address import Address
from servolink.transports.device_info import DeviceInfo, is_accessible

_TRIES = 3


def present() -> list[Any]:
    """List all serial ports, as pyserial describes them.

    While a device vanishes pyserial fails in ways of its own, a TypeError for one; the next look does without it.
    """
    from serial.tools import list_ports  # type: ignore[import-untyped] # brings pyserial, which other kinds do without

    for _ in range(_TRIES):
        try:
            return list(list_ports.comports())
        except Exception:  # noqa: BLE001, S112 - whatever it is, nobody who asks could do more than ask again
            continue
    return []


def candidates() -> list[DeviceInfo]:
    """List the serial ports on USB; others, such as that of a modem or of a Raspberry Pi's pins, have to be named."""
    return list(_candidates())


def _candidates() -> Iterator[DeviceInfo]:
    for port in sorted(present()):
        if port.vid is not None:
            url = f"serial://{quote(port.device)}"
            yield DeviceInfo(url, port.product or "", port.serial_number or "", _problem(port.device))


def _problem(device: str) -> str:
    """Return why it cannot be opened, and what to do; empty if nothing is known, as where a port is no file."""
    if not os.path.exists(device) or is_accessible(device):  # noqa: PTH110 - on Windows it is only a name
        return ""
    return f"no permission for {escape(device)}; `servolink doctor` says how to get it"


class PortTracker:
    """Follows the board behind one address."""

    def __init__(self, url: str) -> None:
        """Follow the board at `url`; only a serial port with a USB serial number ever moves."""
        self._url = url
        self._device = ""
        self._identity: tuple[Any, ...] | None = None
        try:
            address = Address.parse(url)
        except TransportError:
            return  # whoever opens it says so
        if address.scheme == "serial":
            self._device = address.host + address.path

    async def learn(self) -> None:
        """Remember which board is there now, while it is there."""
        if self._device:
            port = (await asyncio.to_thread(_ports)).get(self._device)
            if port is not None and port.serial_number:
                self._identity = _identity(port)

    async def url(self) -> str:
        """Return the address at which the board is now, the first one if it cannot be told."""
        if self._identity is None:
            return self._url
        ports = await asyncio.to_thread(_ports)
        found = [device for device, port in ports.items() if _identity(port) == self._identity]
        if len(found) != 1 or found[0] == self._device:
            return self._url
        _, _, options = self._url.partition("?")
        return f"serial://{found[0]}{'?' if options else ''}{options}"


def _ports() -> dict[str, Any]:

    return {port.device: port for port in present()}


def _identity(port: Any) -> tuple[Any, ...]:
    # A board may have several ports: the interface tells them apart, at the end of the location (1-1:1.0).
    return port.vid, port.pid, port.serial_number, (port.location or "").rpartition(":")[2]
