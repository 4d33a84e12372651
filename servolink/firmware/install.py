"""Installation of the firmware: drive of a Pico in boot mode, and serial port of the board afterwards."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from pathlib import Path

from servolink.boards import search
from servolink.errors import OpenError
from servolink.support import mounted_drives
from servolink.transports import DeviceInfo

USB_ID = (0x2E8A, 0x000A)
"""USB vendor id and product id of the firmware.

Raspberry Pi license these ids for serial ports on the RP2040; a product string tells one firmware from another.
"""
PRODUCT = "servolink board"
"""USB product string of the firmware, by which discovery recognises a board."""
_BOARD = "RPI-RP2"
"""Board id in the file `INFO_UF2.TXT` of a drive, and label of the drive."""
_PAUSE = 0.2
"""Seconds between two searches."""


def find_drives() -> list[Path]:
    """Return the mounted drives of Picos in boot mode."""
    return [drive for drive in mounted_drives() if is_pico(drive)]


def is_pico(drive: Path) -> bool:
    """Return whether the file `INFO_UF2.TXT` of a folder names a Pico in boot mode."""
    try:
        return _BOARD in (drive / "INFO_UF2.TXT").read_text("ascii", "replace")
    except OSError:
        return False


async def wait_for_drive(seconds: float, notify: Callable[[], object]) -> Path:
    """Return the drive of the Pico in boot mode; call `notify` once if there is none yet.

    Raises:
        OpenError: No drive, or several, after so many seconds.

    """
    loop = asyncio.get_running_loop()
    until = loop.time() + seconds
    if not (drives := await asyncio.to_thread(find_drives)):
        notify()
    while not drives:
        if loop.time() > until:
            raise OpenError(
                "no Pico in boot mode was found: hold the button BOOTSEL while you plug the Pico in (one with the chip "
                f"RP2040; a Pico 2 has another); if the drive {_BOARD} is mounted elsewhere, add --drive FOLDER"
            )
        await asyncio.sleep(_PAUSE)
        drives = await asyncio.to_thread(find_drives)
    if len(drives) > 1:
        raise OpenError(f"several Picos are in boot mode, at {', '.join(map(str, drives))}: choose one with --drive")
    return drives[0]


def write(drive: Path, blocks: bytes) -> None:
    """Write the blocks of an image to the drive of a Pico.

    The Pico restarts at the last block: errors of a drive that vanished then are ignored.

    Raises:
        OSError: A block was not written.

    """
    target = os.open(drive / "servolink.uf2", os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_BINARY", 0))
    written = 0
    try:
        while written < len(blocks):
            written += os.write(target, blocks[written:])
        os.fsync(target)
    except OSError:
        if written < len(blocks) or is_pico(drive):
            raise
    finally:
        try:
            os.close(target)
        except OSError:
            if is_pico(drive):
                raise


def ports() -> list[DeviceInfo]:
    """Return the serial ports with ids and product string of the firmware."""
    return [
        device
        for device in search()
        if device.product == PRODUCT and (device.identity.vendor_id, device.identity.product_id) == USB_ID
    ]


async def wait_for_port(before: list[DeviceInfo], seconds: float) -> DeviceInfo:
    """Return the serial port of the new board, which is missing in the list `before`.

    Raises:
        OpenError: No new board within so many seconds.

    """
    loop = asyncio.get_running_loop()
    until = loop.time() + seconds
    known = {device.url for device in before}
    while not (found := [device for device in await asyncio.to_thread(ports) if device.url not in known]):
        if loop.time() > until:
            raise OpenError(
                f"the image was written, but no port of a {PRODUCT!r} appeared within {seconds:g} s: unplug the Pico, "
                "plug the Pico in again, and run `servolink list`"
            )
        await asyncio.sleep(_PAUSE)
    return found[0]
