"""The search for boards, which opens nothing."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterable, Sequence
from importlib import import_module

from servolink.errors import OpenError
from servolink.escaping import escape
from servolink.transports.device_info import DeviceInfo

_KINDS = (
    "servolink.transports.serial_ports",
    "servolink.transports.hid_devices",
    "servolink.transports.usb_devices",
    "servolink.discovery.announcements",
)
"""The modules whose `candidates` find boards, the best way to a board first."""


async def discover() -> list[DeviceInfo]:
    """Return the devices that may be boards, and the virtual boards served on this machine.

    Nothing is opened. A device that cannot be opened is among them; its `problem` says why and what to do. One
    that is reached in several ways is there once for each. What a missing library would find is left out: see
    `servolink doctor`.
    """
    return await asyncio.to_thread(search)


def search() -> list[DeviceInfo]:
    """Do as `discover` does, in this thread, which it blocks."""
    return [candidate for kind in _KINDS for candidate in _candidates(kind)]


def _candidates(module: str) -> list[DeviceInfo]:
    try:
        return list(import_module(module).candidates())
    except Exception:  # noqa: BLE001 - a library that is missing or broken, in ways of its own
        return []


NONE_HERE = (
    "no board was found; plug it in and switch it on, or name one (with --url or SERVOLINK_URL in a shell), as in "
    "serial:///dev/ttyACM0, tcp://192.168.1.20:9000 or virtual://; `servolink doctor` looks for the reason"
)


def boards(candidates: Iterable[DeviceInfo]) -> list[DeviceInfo]:
    """Return one candidate for each board: the first that can be opened, or else the first.

    What has the same serial number is one board that is reached in several ways, unless two are reached in the
    same way: makers of cheap adapters give all of them the same number.
    """
    groups: dict[object, list[DeviceInfo]] = {}
    candidates = list(candidates)
    shared = _shared_numbers(candidates)
    for candidate in candidates:
        number = candidate.serial_number
        groups.setdefault(candidate if not number or number in shared else number, []).append(candidate)
    return [next((way for way in ways if not way.problem), ways[0]) for ways in groups.values()]


def only(candidates: Sequence[DeviceInfo]) -> str:
    """Return the address of the only board, or of the only one that can be opened; OpenError names them all."""
    found = boards(candidates)
    usable = [board for board in found if not board.problem]
    if len(usable) == 1:
        return usable[0].url
    if not found:
        raise OpenError(NONE_HERE)
    if len(found) == 1:
        raise OpenError(f"{escape(found[0].url)}: {escape(found[0].problem)}")
    raise OpenError(f"{len(found)} boards are here; name one of {', '.join(escape(board.url) for board in found)}")


def scheme(candidate: DeviceInfo) -> str:
    """Return how `candidate` is reached."""
    return candidate.url.partition("://")[0]


def _shared_numbers(candidates: Iterable[DeviceInfo]) -> set[str]:
    uses = Counter((scheme(candidate), candidate.serial_number) for candidate in candidates)
    return {number for (_, number), count in uses.items() if count > 1}
