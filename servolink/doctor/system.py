"""Facts of the system in one object, which tests replace by the facts of another system."""

from __future__ import annotations

import importlib.util
import os
import stat
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from servolink.escaping import escape
from servolink.platforms import process
from servolink.transports.address import Address
from servolink.transports.device_info import PortIdentity, is_accessible

_USB_DEVICES = "/sys/bus/usb/devices"

_LONGEST = 65536  # characters that are read of one file


@dataclass(frozen=True, slots=True)
class Node:
    """Owner and permissions of a device file."""

    owner: str
    group: str
    mode: int
    """Its permission bits."""
    is_accessible: bool
    """Whether this process may read and write it."""


@dataclass(frozen=True, slots=True)
class Process:
    """A running program."""

    pid: int
    name: str
    files: frozenset[str]
    """The paths that it has open; empty if it belongs to another user."""


class SystemFacts:
    """Facts of this system, read on demand; a fact that cannot be read is empty, and nothing raises."""

    def __init__(self, root: Path = Path("/"), platform: str = sys.platform) -> None:
        """Read files below `root`."""
        self.root = root
        self.platform = platform
        self.environment: Mapping[str, str] = os.environ
        self.python = sys.executable
        """The command that runs this Python."""
        self.pid = os.getpid()

    @property
    def user(self) -> str:
        """The name of the user this process runs as; empty where users have no numbers."""
        return process.own_name()

    @property
    def groups(self) -> frozenset[str]:
        """The groups this process is in."""
        return process.own_groups()

    def members(self, group: str) -> list[str] | None:
        """Return the members of `group`, counted from their next login on; None if there is no such group."""
        return process.members(group)

    def text(self, path: str) -> str:
        """Return the text of a file without surrounding space; empty if it cannot be read."""
        try:
            with self._here(path).open(encoding="utf-8", errors="replace") as file:
                return file.read(_LONGEST).strip()
        except (OSError, ValueError):
            return ""

    def names(self, folder: str) -> list[str]:
        """Return the sorted names in a folder; empty if it cannot be read."""
        try:
            return sorted(path.name for path in self._here(folder).iterdir())
        except (OSError, ValueError):
            return []

    def link(self, path: str) -> str:
        """Return the target of a symbolic link; empty for anything else."""
        try:
            return str(self._here(path).readlink())
        except (OSError, ValueError):
            return ""

    def real(self, path: str) -> str:
        """Return the path without symbolic links."""
        try:
            below = Path(os.path.realpath(self._here(path))).relative_to(os.path.realpath(self.root))
        except (OSError, ValueError):
            return path
        return f"/{below.as_posix()}"

    def node(self, path: str) -> Node | None:
        """Return owner and permissions of a device file; None if there is no such file."""
        try:
            status = self._here(path).stat()
        except (OSError, ValueError):
            return None
        return Node(
            owner=process.user_name(status.st_uid),
            group=process.group_name(status.st_gid),
            mode=stat.S_IMODE(status.st_mode),
            is_accessible=is_accessible(str(self._here(path))),
        )

    def processes(self) -> Iterator[Process]:
        """Yield the running programs, where the system shows them as files."""
        for name in self.names("/proc"):
            if name.isdecimal():
                folder = f"/proc/{name}"
                files = frozenset(self.link(f"{folder}/fd/{number}") for number in self.names(f"{folder}/fd"))
                yield Process(int(name), escape(self.text(f"{folder}/comm")), files)

    def module(self, name: str) -> str:
        """Return the file from which Python would import a module; empty if it finds none."""
        try:
            found = importlib.util.find_spec(name)
        except (ImportError, ValueError):
            return ""
        return (found.origin or "") if found else ""

    def libusb(self) -> bool:
        """Return whether pyusb finds a libusb."""
        try:
            import libusb_package

            return libusb_package.get_libusb1_backend() is not None
        except Exception:  # noqa: BLE001 - a missing or broken library fails in ways of its own
            return False

    def _here(self, path: str) -> Path:
        return self.root / path.lstrip("/")


@dataclass(frozen=True, slots=True)
class ListedUsbDevice:
    """A USB device as the system describes it; its texts come from the device itself."""

    folder: str
    vendor_id: int
    product_id: int
    serial_number: str
    product: str

    @property
    def identity(self) -> PortIdentity:
        """The identity by which addresses name it."""
        return PortIdentity(self.vendor_id, self.product_id, self.serial_number)


def serial_device(url: str) -> str:
    """Return the device file or COM port of a serial port's address; empty for other addresses."""
    return Address.parse(url).serial_device


def device_nodes(facts: SystemFacts, url: str) -> list[str]:
    """Return the device files that have to be opened for `url`."""
    if device := serial_device(url):
        return [facts.real(device)]
    scheme = Address.parse(url).scheme
    if scheme == "hid":
        return [
            f"/dev/{name}"
            for name in facts.names("/sys/class/hidraw")
            if (parent := _usb_parent(facts, f"/sys/class/hidraw/{name}/device")) and _is_meant(url, parent)
        ]
    if scheme == "usb":
        return [
            f"/dev/bus/usb/{facts.text(f'{device.folder}/busnum'):0>3}/{facts.text(f'{device.folder}/devnum'):0>3}"
            for device in usb_devices(facts)
            if _is_meant(url, device)
        ]
    return []


def usb_device(facts: SystemFacts, url: str) -> ListedUsbDevice | None:
    """Return the USB device that `url` leads to; None if it is not on USB or not plugged in."""
    if device := serial_device(url):
        return _usb_parent(facts, f"/sys/class/tty/{PurePosixPath(facts.real(device)).name}/device")
    if Address.parse(url).scheme in {"hid", "usb"}:
        return next((device for device in usb_devices(facts) if _is_meant(url, device)), None)
    return None


def usb_devices(facts: SystemFacts) -> Iterator[ListedUsbDevice]:
    """Yield the USB devices that are plugged in."""
    for name in facts.names(_USB_DEVICES):
        if (device := _described(facts, facts.real(f"{_USB_DEVICES}/{name}"))) is not None:
            yield device


def named_usb_device(url: str) -> ListedUsbDevice | None:
    """Return the USB device that `url` itself describes, plugged in or not; None if it names no ids."""
    address = Address.parse(url)
    if address.scheme not in {"hid", "usb"}:
        return None
    named = PortIdentity.from_address(address)
    if named.vendor_id is None or named.product_id is None:
        return None
    return ListedUsbDevice("", named.vendor_id, named.product_id, named.serial_number, "")


def _usb_parent(facts: SystemFacts, path: str) -> ListedUsbDevice | None:
    """Return the USB device above a file of the system's device tree."""
    above = PurePosixPath(facts.real(path))
    return next(
        (device for folder in (above, *above.parents) if (device := _described(facts, str(folder))) is not None), None
    )


def _described(facts: SystemFacts, folder: str) -> ListedUsbDevice | None:
    try:
        vendor_id = int(facts.text(f"{folder}/idVendor"), 16)
        product_id = int(facts.text(f"{folder}/idProduct"), 16)
    except ValueError:
        return None
    return ListedUsbDevice(
        folder, vendor_id, product_id, facts.text(f"{folder}/serial"), facts.text(f"{folder}/product")
    )


def _is_meant(url: str, device: ListedUsbDevice) -> bool:
    wanted = PortIdentity.from_address(Address.parse(url))
    return not wanted.is_any and wanted.fits(device.identity)
