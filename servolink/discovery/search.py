"""The search for boards, which opens nothing."""

from __future__ import annotations

import asyncio
from importlib import import_module

from servolink.transports.candidate import Candidate

_KINDS = (
    "servolink.transports.serial_ports",
    "servolink.transports.hid_devices",
    "servolink.transports.usb_devices",
    "servolink.discovery.served",
)
"""The modules whose `candidates` find boards, the best way to a board first."""


async def discover() -> list[Candidate]:
    """Return the devices that may be boards, and the virtual boards served on this machine.

    Nothing is opened. A device that cannot be opened is among them; its `problem` says why and what to do. One
    that is reached in several ways is there once for each. What a missing library would find is left out: see
    `servolink doctor`.
    """
    return await asyncio.to_thread(search)


def search() -> list[Candidate]:
    """Do as `discover` does, in this thread, which it blocks."""
    return [candidate for kind in _KINDS for candidate in _candidates(kind)]


def _candidates(module: str) -> list[Candidate]:
    try:
        return list(import_module(module).candidates())
    except Exception:  # noqa: BLE001 - a library that is missing or broken, in ways of its own
        return []
