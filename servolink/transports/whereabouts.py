"""Where a board is now: a serial port's name may change when it is plugged in again, its USB serial number not."""

from __future__ import annotations

import asyncio
from typing import Any

from servolink.errors import TransportError
from servolink.transports.address import Address


class Whereabouts:
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
    from servolink.transports.serial_ports import present  # brings pyserial, which other kinds do without

    return {port.device: port for port in present()}


def _identity(port: Any) -> tuple[Any, ...]:
    # A board may have several ports: the interface tells them apart, at the end of the location (1-1:1.0).
    return port.vid, port.pid, port.serial_number, (port.location or "").rpartition(":")[2]
