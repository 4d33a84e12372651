"""Which serial ports can be boards: those on USB, as the system lists them without opening any."""

from __future__ import annotations

import os
from collections.abc import Iterator
from urllib.parse import quote

from serial.tools import list_ports  # type: ignore[import-untyped]

from servolink.printable import printable
from servolink.transports.candidate import Candidate
from servolink.transports.permission import may_use


def candidates() -> list[Candidate]:
    """List the serial ports on USB; others, such as that of a modem or of a Raspberry Pi's pins, have to be named."""
    return list(_candidates())


def _candidates() -> Iterator[Candidate]:
    for port in sorted(list_ports.comports()):
        if port.vid is not None:
            url = f"serial://{quote(port.device)}"
            yield Candidate(url, port.product or "", port.serial_number or "", _problem(port.device))


def _problem(device: str) -> str:
    """Return why it cannot be opened, and what to do; empty if nothing is known, as where a port is no file."""
    if not os.path.exists(device) or may_use(device):  # noqa: PTH110 - on Windows it is only a name
        return ""
    return f"no permission for {printable(device)}; `servolink doctor` says how to get it"
