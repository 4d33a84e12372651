"""Facts of the system in an object that tests replace by facts of another system."""

from __future__ import annotations

import importlib.util
import os
import stat
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from servolink.errors import escape
from servolink.support import Account
from servolink.transports import Address, PortIdentity, is_accessible

_USB_DEVICES = "/sys/bus/usb/devices"

_LONGEST = 65536  # characters read from a single file


@dataclass(frozen=True, slots=True)
class Node:
    """Owner and permissions of a device file."""

    owner: str
    group: str
    mode: int
    """Permission bits of the file."""
    is_accessible: bool
    """Whether the present process may read and write the file."""


@dataclass(frozen=True, slots=True)
class Process:
    """Running program, with its open files."""

    pid: int
    name: str
    files: frozenset[str]
    """Paths of the open files; empty for a process of another user."""


class SystemFacts:
    """Facts of the present system, read on demand; an unreadable fact is empty, and no error is raised."""

    def __init__(self, root: Path = Path("/"), platform: str = sys.platform) -> None:
        """Read files below the folder `root`."""
        self.root = root
        self.platform = platform
        self.environment: Mapping[str, str] = os.environ
        self.python = sys.executable
        """Command that runs the present Python."""
        self.pid = os.getpid()

    @property
    def user(self) -> str:
        """Name of the user of the process; empty on systems without user numbers."""
        return Account.of_process().user

    @property
    def groups(self) -> frozenset[str]:
        """Groups of the present process."""
        return Account.of_process().groups

    def members(self, group: str) -> list[str] | None:
        """Return the members of `group`, counted from their next login on; None for a missing group."""
        return Account.members(group)

    def text(self, path: str) -> str:
        """Return the text of a file without surrounding space; empty for an unreadable file."""
        try:
            with self._below_root(path).open(encoding="utf-8", errors="replace") as file:
                return file.read(_LONGEST).strip()
        except (OSError, ValueError):
            return ""

    def names(self, folder: str) -> list[str]:
        """Return the sorted names in a folder; empty for an unreadable folder."""
        try:
            return sorted(path.name for path in self._below_root(folder).iterdir())
        except (OSError, ValueError):
            return []

    def link(self, path: str) -> str:
        """Return the target of a symbolic link; empty for anything else."""
        try:
            return str(self._below_root(path).readlink())
        except (OSError, ValueError):
            return ""

    def real(self, path: str) -> str:
        """Return the path without symbolic links."""
        try:
            below = Path(os.path.realpath(self._below_root(path))).relative_to(os.path.realpath(self.root))
        except (OSError, ValueError):
            return path
        return f"/{below.as_posix()}"

    def node(self, path: str) -> Node | None:
        """Return owner and permissions of a device file; None for a missing file."""
        try:
            status = self._below_root(path).stat()
        except (OSError, ValueError):
            return None
        account = Account.of_file(status)
        return Node(
            owner=account.user,
            group=", ".join(account.groups),
            mode=stat.S_IMODE(status.st_mode),
            is_accessible=is_accessible(str(self._below_root(path))),
        )

    def processes(self) -> Iterator[Process]:
        """Yield the running programs, on systems that show processes as files."""
        for name in self.names("/proc"):
            if name.isdecimal():
                folder = f"/proc/{name}"
                files = frozenset(self.link(f"{folder}/fd/{number}") for number in self.names(f"{folder}/fd"))
                yield Process(int(name), escape(self.text(f"{folder}/comm")), files)

    def module(self, name: str) -> str:
        """Return the file of a module as found by Python; empty for a missing module."""
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

    def _below_root(self, path: str) -> Path:
        return self.root / path.lstrip("/")


@dataclass(frozen=True, slots=True)
class ListedUsbDevice:
    """USB device as described by the system; the texts come from the device itself."""

    folder: str
    vendor_id: int
    product_id: int
    serial_number: str
    product: str

    @property
    def identity(self) -> PortIdentity:
        """Identity of the port, as used in addresses."""
        return PortIdentity(self.vendor_id, self.product_id, self.serial_number)


def serial_device(url: str) -> str:
    """Return the device file or COM port of a serial port's address; empty for other addresses."""
    return Address.parse(url).serial_device


def device_nodes(facts: SystemFacts, url: str) -> list[str]:
    """Return the device files to open for `url`."""
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
    """Return the USB device at `url`; None for any other address, and for an unplugged device."""
    if device := serial_device(url):
        return _usb_parent(facts, f"/sys/class/tty/{PurePosixPath(facts.real(device)).name}/device")
    if Address.parse(url).scheme in {"hid", "usb"}:
        return next((device for device in usb_devices(facts) if _is_meant(url, device)), None)
    return None


def usb_devices(facts: SystemFacts) -> Iterator[ListedUsbDevice]:
    """Yield all plugged-in USB devices."""
    for name in facts.names(_USB_DEVICES):
        if (device := _described(facts, facts.real(f"{_USB_DEVICES}/{name}"))) is not None:
            yield device


def named_usb_device(url: str) -> ListedUsbDevice | None:
    """Return the USB device described by `url` itself, plugged in or not; None without ids in `url`."""
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
    identity = PortIdentity.from_address(Address.parse(url))
    return not identity.is_any and identity.fits(device.identity)
