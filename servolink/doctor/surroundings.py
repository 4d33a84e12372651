"""Where this program runs, and what that keeps it from seeing."""

from __future__ import annotations

from collections.abc import Iterator

from servolink.doctor.facts import SystemFacts
from servolink.doctor.finding import Finding
from servolink.doctor.nodes import device_of
from servolink.printable import printable


def check_surroundings(facts: SystemFacts) -> Iterator[Finding]:
    """Find what hides devices that are plugged in; meant for when none is seen."""
    if "microsoft" in facts.text("/proc/version").lower():
        yield Finding(
            "WSL",
            "this is Linux inside Windows (WSL)",
            "USB devices stay with Windows until they are handed over, after each plugging in",
            "in PowerShell as administrator: usbipd list\nusbipd bind --busid BUSID\nusbipd attach --wsl --busid BUSID",
        )
    if container := _container(facts):
        yield Finding(
            "container",
            f"this runs in a container ({container})",
            "devices of the machine are not in it unless they are passed in when it is started",
            "docker run --device=/dev/ttyACM0 ...\nfor HID and USB: --device=/dev/hidraw0, --device=/dev/bus/usb",
        )
    if sandbox := _sandbox(facts):
        yield Finding(
            "sandbox",
            f"this Python is packed as {sandbox}",
            f"{sandbox} hides devices from the programs in it",
            "run servolink with the Python of the system, in an environment of its own: python3 -m venv",
        )


def check_address(facts: SystemFacts, url: str) -> Iterator[Finding]:
    """Find addresses that are meant for something else on this system."""
    device = device_of(url)
    if facts.platform == "darwin" and device.startswith("/dev/tty."):
        right = printable(device.replace("/dev/tty.", "/dev/cu.", 1))
        yield Finding(
            "macOS port",
            f"the address names {printable(device)}",
            "opening a tty. port waits for a carrier signal, which boards do not give; its cu. twin does not",
            f"--url serial://{right}",
        )


def _container(facts: SystemFacts) -> str:
    if facts.node("/.dockerenv"):
        return "Docker"
    if facts.node("/run/.containerenv"):
        return "Podman"
    groups = facts.text("/proc/1/cgroup")
    known = next((name for name in ("docker", "kubepods", "lxc") if name in groups), "")
    return known or printable(facts.environment.get("container", ""))


def _sandbox(facts: SystemFacts) -> str:
    if facts.node("/.flatpak-info"):
        return "Flatpak"
    return "a snap" if "SNAP" in facts.environment else ""
