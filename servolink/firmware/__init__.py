"""Firmware for boards made of a Raspberry Pi Pico: C sources, image, compilation and installation."""

from __future__ import annotations

from servolink.firmware.compiling import IMAGE, build
from servolink.firmware.image import SERVOS, ImageSettings, Range, from_uf2, read_settings, to_uf2, with_settings
from servolink.firmware.install import PRODUCT, USB_ID, is_pico, ports, wait_for_drive, wait_for_port, write

__all__ = [
    # image
    "IMAGE",
    "SERVOS",
    "ImageSettings",
    "Range",
    "build",
    "from_uf2",
    "read_settings",
    "to_uf2",
    "with_settings",
    # installation
    "PRODUCT",
    "USB_ID",
    "is_pico",
    "ports",
    "wait_for_drive",
    "wait_for_port",
    "write",
]
