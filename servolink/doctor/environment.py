"""Disturbances around a board: other programs, adapters, libraries and the kind of system."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import PurePosixPath

from servolink.boards import hub_of
from servolink.doctor.finding import Finding
from servolink.doctor.permissions import ADAPTERS, INSTALL, rule_named
from servolink.doctor.system import (
    ListedUsbDevice,
    Process,
    SystemFacts,
    device_nodes,
    serial_device,
    usb_device,
    usb_devices,
)
from servolink.errors import escape

LATENCY_TIMER = "latency timer"
_LATENCY_CAUSE = "an FTDI adapter holds short responses back until its latency timer, usually 16 ms, has expired"
_LONGEST_TIMER = 2  # milliseconds, too short to matter
_NEAR_16_MS = (0.0135, 0.0185)  # seconds: the timer itself, and the short way there and back
_FEWEST_ROUND_TRIPS = 10  # minimum of round trips for a conclusion
_PTY_MASTERS = {"/dev/ptmx", "/dev/pts/ptmx"}
_COMPILED = (".so", ".pyd")  # modules of hidapi; the other package has none


def check_modem_manager(facts: SystemFacts, url: str) -> Iterator[Finding]:
    """Find ModemManager, unless a rule keeps ModemManager away from the port."""
    device = serial_device(url)
    if not device or usb_device(facts, url) is None or not _is_running(facts, "ModemManager"):
        return
    number = facts.text(f"/sys/class/tty/{PurePosixPath(facts.real(device)).name}/dev")
    if "E:ID_MM_DEVICE_IGNORE=1" not in facts.text(f"/run/udev/data/c{number}").splitlines():
        yield Finding(
            "ModemManager",
            f"ModemManager is running, and nothing keeps it away from {escape(device)}",
            "ModemManager may mistake a new port for a modem: for up to 20 s the port is busy and receives bytes",
            f"{INSTALL}\nor, if you have no modem: sudo systemctl disable --now ModemManager",
        )


def check_brltty(facts: SystemFacts) -> Iterator[Finding]:
    """Find USB adapters without a port while brltty, for Braille displays, is installed and may hold the ports."""
    rule = rule_named(facts, "brltty")
    if not rule and not _is_running(facts, "brltty"):
        return
    for device in usb_devices(facts):
        chip = ADAPTERS.get((device.vendor_id, device.product_id))
        if chip and not _has_port(facts, device):
            mask = f"\nif you have a Braille display: sudo ln -s /dev/null /etc/udev/rules.d/{PurePosixPath(rule).name}"
            yield Finding(
                "brltty",
                f"a {chip} adapter ({device.vendor_id:04x}:{device.product_id:04x}) is plugged in and has no serial "
                "port, and brltty is installed",
                "brltty mistakes such adapters for Braille displays; the port appears for a second and vanishes",
                "if you have no Braille display: sudo apt remove brltty"
                + (mask if rule else "")
                + "\nunplug the board and plug it in again",
            )


def _is_running(facts: SystemFacts, name: str) -> bool:
    return any(process.name == name for process in facts.processes())


def _has_port(facts: SystemFacts, device: ListedUsbDevice) -> bool:
    return any(
        name.startswith("tty")
        for interface in facts.names(device.folder)
        if ":" in interface
        for name in facts.names(f"{device.folder}/{interface}")
    )


def check_holders(facts: SystemFacts, url: str) -> Iterator[Finding]:
    """Find programs with the device of `url` open; programs of other users are visible only to root."""
    if (hub := hub_of(url)) is not None:
        yield Finding(
            "in use",
            f"{escape(url)} is {hub.product}",
            "the hub has the board open; any number of programs can use it through the hub",
            f"servolink --board {hub.url} info\nto see its programs: servolink share --status",
        )
        return
    nodes = {path for path in device_nodes(facts, url) if not serial_device(url) or _is_terminal(facts, path)}
    if not nodes:
        return
    for process in facts.processes():
        for path in sorted(nodes & process.files):
            if process.pid != facts.pid and not _serves(process, path):
                yield Finding(
                    "in use",
                    f"process {process.pid} ({process.name or 'unknown'}) has {escape(path)} open",
                    "two programs on a port take each other's bytes, and most ports admit only a single program",
                    f"close the program, or: kill {process.pid}",
                )


def _is_terminal(facts: SystemFacts, path: str) -> bool:
    """Return whether `path` may be a serial port, unlike for example /dev/null, open in every program."""
    terminals = facts.names("/sys/class/tty")
    return not terminals or path.startswith("/dev/pts/") or PurePosixPath(path).name in terminals


def _serves(process: Process, path: str) -> bool:
    """Return whether `process` serves a pseudo-terminal: such a process may hold both ends, like our virtual board."""
    return path.startswith("/dev/pts/") and bool(process.files & _PTY_MASTERS)


def check_latency_timer(facts: SystemFacts, url: str) -> Iterator[Finding]:
    """Find a latency timer longer than needed, as is the default."""
    name = PurePosixPath(facts.real(serial_device(url))).name
    path = f"/sys/bus/usb-serial/devices/{name}/latency_timer"
    timer = facts.text(path)
    if timer.isdecimal() and int(timer) > _LONGEST_TIMER:
        yield Finding(LATENCY_TIMER, f"{path} is {timer} ms", _LATENCY_CAUSE, _remedy(facts, name))


def check_round_trips(facts: SystemFacts, url: str, round_trips: Sequence[float]) -> Iterator[Finding]:
    """Find round trips (in seconds) near the default of the latency timer."""
    low, high = _NEAR_16_MS
    near = [seconds for seconds in round_trips if low <= seconds <= high]
    if len(round_trips) >= _FEWEST_ROUND_TRIPS and len(near) * 2 >= len(round_trips):
        name = PurePosixPath(facts.real(serial_device(url))).name
        evidence = f"{len(near)} of {len(round_trips)} responses took {low * 1000:g} to {high * 1000:g} ms"
        yield Finding(LATENCY_TIMER, evidence, f"typical when {_LATENCY_CAUSE}", _remedy(facts, name))


def _remedy(facts: SystemFacts, name: str) -> str:
    if facts.platform == "win32":
        return f"Device Manager, Ports, {name}, Properties, Port Settings, Advanced: Latency Timer 1 ms"
    if facts.platform == "linux" and name.startswith("ttyUSB"):
        return (
            f"until it is unplugged: echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer\n"
            "for good: install the rule printed by `servolink doctor --print-udev`"
        )
    return "set the latency timer of the adapter to 1 ms on the computer with the adapter"


def check_hid(facts: SystemFacts) -> Iterator[Finding]:
    """Find a missing hidapi, or the other package with a module called `hid`."""
    names = ("hidraw", "hid") if facts.platform == "linux" else ("hid",)
    origins = [facts.module(name) for name in names]
    if any(origin.endswith(_COMPILED) for origin in origins):
        return
    if any(origins):
        yield Finding(
            "hid package",
            f"`import hid` finds {next(filter(None, origins))}",
            "the package hid is another library, with the same module name as hidapi",
            f"{facts.python} -m pip uninstall hid\n{facts.python} -m pip install --force-reinstall hidapi",
        )
    else:
        yield Finding(
            "hid package",
            "Python finds no module hid",
            "boards cannot be reached through HID",
            f"{facts.python} -m pip install hidapi",
        )


def check_libusb(facts: SystemFacts) -> Iterator[Finding]:
    """Find a missing libusb library for USB."""
    if not facts.module("usb") or not facts.libusb():
        yield Finding(
            "libusb",
            "pyusb finds no libusb" if facts.module("usb") else "Python finds no module usb",
            "boards cannot be reached through USB bulk transfers",
            f"{facts.python} -m pip install --force-reinstall pyusb libusb-package",
        )


def check_surroundings(facts: SystemFacts) -> Iterator[Finding]:
    """Find reasons why a plugged-in device may be invisible."""
    if "microsoft" in facts.text("/proc/version").lower():
        yield Finding(
            "WSL",
            "the system is Linux inside Windows (WSL)",
            "USB devices stay with Windows until handed over, after every plugging in",
            "in PowerShell as administrator: usbipd list\nusbipd bind --busid BUSID\nusbipd attach --wsl --busid BUSID",
        )
    if container := _container(facts):
        yield Finding(
            "container",
            f"servolink runs in a container ({container})",
            "a container sees only the devices of the computer that were passed in at the start",
            "docker run --device=/dev/ttyACM0 ...\nfor HID and USB: --device=/dev/hidraw0, --device=/dev/bus/usb",
        )
    if sandbox := _sandbox(facts):
        yield Finding(
            "sandbox",
            f"this Python is packaged as {sandbox}",
            f"{sandbox} hides devices from programs inside",
            "run servolink with the system's Python, in a virtual environment: python3 -m venv",
        )


def check_address(facts: SystemFacts, url: str) -> Iterator[Finding]:
    """Find an address with another purpose on the present system."""
    device = serial_device(url)
    if facts.platform == "darwin" and device.startswith("/dev/tty."):
        right = escape(device.replace("/dev/tty.", "/dev/cu.", 1))
        yield Finding(
            "macOS port",
            f"the address names {escape(device)}",
            "a tty. port waits for a carrier signal, never given by boards; the cu. port does not wait",
            f"use the other port: --board serial://{right}",
        )


def _container(facts: SystemFacts) -> str:
    if facts.node("/.dockerenv"):
        return "Docker"
    if facts.node("/run/.containerenv"):
        return "Podman"
    groups = facts.text("/proc/1/cgroup")
    runtime = next((name for name in ("docker", "kubepods", "lxc") if name in groups), "")
    return runtime or escape(facts.environment.get("container", ""))


def _sandbox(facts: SystemFacts) -> str:
    if facts.node("/.flatpak-info"):
        return "Flatpak"
    return "a snap" if "SNAP" in facts.environment else ""
