"""Which serial ports can be boards: those on USB, as the system lists them without opening any."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any
from urllib.parse import quote

from serial.tools import list_ports  # type: ignore[import-untyped]

from servolink.printable import printable
from servolink.transports.candidate import Candidate
from servolink.transports.permission import may_use

_TRIES = 3


def present() -> list[Any]:
    """List all serial ports, as pyserial describes them.

    While a device vanishes pyserial fails in ways of its own, a TypeError for one; the next look does without it.
    """
    for _ in range(_TRIES):
        try:
            return list(list_ports.comports())
        except Exception:  # noqa: BLE001, S112 - whatever it is, nobody who asks could do more than ask again
            continue
    return []


def candidates() -> list[Candidate]:
    """List the serial ports on USB; others, such as that of a modem or of a Raspberry Pi's pins, have to be named."""
    return list(_candidates())


def _candidates() -> Iterator[Candidate]:
    for port in sorted(present()):
        if port.vid is not None:
            url = f"serial://{quote(port.device)}"
            yield Candidate(url, port.product or "", port.serial_number or "", _problem(port.device))


def _problem(device: str) -> str:
    """Return why it cannot be opened, and what to do; empty if nothing is known, as where a port is no file."""
    if not os.path.exists(device) or may_use(device):  # noqa: PTH110 - on Windows it is only a name
        return ""
    return f"no permission for {printable(device)}; `servolink doctor` says how to get it"
