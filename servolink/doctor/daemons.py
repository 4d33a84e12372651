"""Programs of the system that take or disturb serial ports: brltty and ModemManager."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePosixPath

from servolink.doctor.facts import SystemFacts
from servolink.doctor.finding import Finding
from servolink.doctor.nodes import UsbDevice, device_of, usb_device, usb_devices
from servolink.doctor.udev import ADAPTERS, INSTALL, rule_named
from servolink.printable import printable


def check_modem_manager(facts: SystemFacts, url: str) -> Iterator[Finding]:
    """Find ModemManager if it has not been told to keep away from the port."""
    device = device_of(url)
    if not device or usb_device(facts, url) is None or not _is_running(facts, "ModemManager"):
        return
    number = facts.text(f"/sys/class/tty/{PurePosixPath(facts.real(device)).name}/dev")
    if "E:ID_MM_DEVICE_IGNORE=1" not in facts.text(f"/run/udev/data/c{number}").splitlines():
        yield Finding(
            "ModemManager",
            f"ModemManager is running, and nothing keeps it away from {printable(device)}",
            "it may take a newly plugged port for a modem: for up to 20 s the port is busy and gets bytes from it",
            f"{INSTALL}\nwithout a modem, simply: sudo systemctl disable --now ModemManager",
        )


def check_brltty(facts: SystemFacts) -> Iterator[Finding]:
    """Find USB adapters without a port while brltty, for Braille displays, is there to take them."""
    rule = rule_named(facts, "brltty")
    if not rule and not _is_running(facts, "brltty"):
        return
    for device in usb_devices(facts):
        chip = ADAPTERS.get((device.vendor_id, device.product_id))
        if chip and not _has_port(facts, device):
            mask = f"\nwith one, let it keep away: sudo ln -s /dev/null /etc/udev/rules.d/{PurePosixPath(rule).name}"
            yield Finding(
                "brltty",
                f"a {chip} adapter ({device.vendor_id:04x}:{device.product_id:04x}) is plugged in and has no serial "
                "port, and brltty is installed",
                "brltty takes such adapters for Braille displays; their port appears for a second and is gone",
                "without a Braille display: sudo apt remove brltty"
                + (mask if rule else "")
                + "\nunplug the board and plug it in again",
            )


def _is_running(facts: SystemFacts, name: str) -> bool:
    return any(process.name == name for process in facts.processes())


def _has_port(facts: SystemFacts, device: UsbDevice) -> bool:
    return any(
        name.startswith("tty")
        for interface in facts.names(device.folder)
        if ":" in interface
        for name in facts.names(f"{device.folder}/{interface}")
    )
