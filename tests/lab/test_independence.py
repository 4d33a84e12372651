"""Odd boards are written from the document alone; they and the USB device are passed bytes and times."""

from __future__ import annotations

from pathlib import Path

from tests.test_imports import OUTSIDE_WORLD, imported

LAB = Path(__file__).parent
SERVING = {"usbip_server.py"}
"""The module that connects the USB device to the world."""


def sources(folder: str) -> list[Path]:
    """Return the modules of a folder, without its tests and what only they import."""
    found = (LAB / folder).glob("*.py")
    return [path for path in found if not path.name.startswith("test_") and path.name != "usbip_host.py"]


def test_odd_boards_share_no_code_with_servolink() -> None:
    found = {(path.name, source) for path in sources("odd") for source, _ in imported(path)}
    assert {source for _, source in found if source.startswith("tests.lab.odd")}
    assert {(name, source) for name, source in found if source.startswith("servolink")} == set()


def test_odd_boards_and_the_usb_device_are_passed_bytes_and_times() -> None:
    world = {
        (path.name, source)
        for folder in ("odd", "usbip")
        for path in sources(folder)
        if path.name not in SERVING
        for source, name in imported(path)
        if source.partition(".")[0] in OUTSIDE_WORLD and (source, name) != ("random", "Random")
    }
    assert world == set()
