"""Whether the libraries for HID and USB are there, and are the right ones."""

from __future__ import annotations

from collections.abc import Iterator

from servolink.doctor.facts import SystemFacts
from servolink.doctor.finding import Finding

_COMPILED = (".so", ".pyd")  # hidapi's modules are; those of the other package are not


def check_hid(facts: SystemFacts) -> Iterator[Finding]:
    """Find a missing hidapi, and the other package whose module is called `hid` too."""
    names = ("hidraw", "hid") if facts.platform == "linux" else ("hid",)
    origins = [facts.module(name) for name in names]
    if any(origin.endswith(_COMPILED) for origin in origins):
        return
    if any(origins):
        yield Finding(
            "hid package",
            f"`import hid` finds {next(filter(None, origins))}",
            "this is the package hid, which has the same name in Python as hidapi and is something else",
            f"{facts.python} -m pip uninstall hid\n{facts.python} -m pip install --force-reinstall hidapi",
        )
    else:
        yield Finding(
            "hid package",
            "there is no module hid",
            "boards cannot be reached through HID",
            f"{facts.python} -m pip install hidapi",
        )


def check_libusb(facts: SystemFacts) -> Iterator[Finding]:
    """Find a missing libusb."""
    if not facts.module("usb") or not facts.libusb():
        yield Finding(
            "libusb",
            "pyusb finds no libusb" if facts.module("usb") else "there is no module usb",
            "boards cannot be reached through USB bulk transfers",
            f"{facts.python} -m pip install --force-reinstall pyusb libusb-package",
        )
