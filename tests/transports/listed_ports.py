"""Serial ports as pyserial lists them, in place of those of this machine."""

from __future__ import annotations

import pytest
from serial.tools import list_ports, list_ports_common  # type: ignore[import-untyped]


def port(
    device: str,
    vid: int | None = None,
    product: str | None = None,
    number: str | None = None,
    *,
    pid: int | None = None,
    location: str = "",
) -> object:
    found = list_ports_common.ListPortInfo(device)
    found.vid, found.pid, found.product, found.serial_number, found.location = vid, pid, product, number, location
    return found


def listed(monkeypatch: pytest.MonkeyPatch, *ports: object) -> None:
    """Let these be the serial ports that are here."""
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
