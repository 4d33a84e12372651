"""Search for USB interfaces of boards: vendor-defined, with a pair of bulk endpoints."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import usb.core  # type: ignore[import-untyped]
import usb.util  # type: ignore[import-untyped]

from servolink.errors import TransportUnavailable
from servolink.transports.device_info import ANY_DEVICE, UDEV_CURE, DeviceInfo, PortIdentity, is_accessible

_DESCRIPTIONS = Path("/sys/bus/usb/devices")
_NODES = Path("/dev/bus/usb")
_VENDOR_CLASS = 0xFF
_BULK = 2
_FREE = {"", "usbfs"}  # drivers of an interface without a driver of the kernel


class Endpoints(NamedTuple):
    """Addresses of two endpoints, and the sizes of their packets in bytes."""

    incoming: int
    incoming_size: int
    outgoing: int
    outgoing_size: int


@dataclass(frozen=True, slots=True)
class UsbInterface:
    """Interface of a possible board; `device`, `configuration` and `interface` are objects of pyusb."""

    device: Any
    configuration: Any
    interface: Any
    identity: PortIdentity
    product: str
    driver: str  # driver of the kernel, if visible; "usbfs" stands for another program
    exclusive: bool  # whether no other interface of the device can be a board

    @property
    def number(self) -> int:
        """Number of the interface within the device."""
        return int(self.interface.bInterfaceNumber)

    @property
    def url(self) -> str:
        """Address of the interface, with the interface number if the device has several such interfaces."""
        return self.identity.url("usb", "" if self.exclusive else f"interface={self.number}")

    @property
    def problem(self) -> str:
        """Reason why the interface cannot be opened, with the remedy; empty without a known problem."""
        node = _NODES / f"{self.device.bus or 0:03d}" / f"{self.device.address or 0:03d}"
        if not is_accessible(str(node)):
            return f"no permission for {node}; {UDEV_CURE}"
        if self.driver == "usbfs":
            return "the interface is in use by another program; close that program"
        return ""

    def endpoints(self, incoming: int | None = None, outgoing: int | None = None) -> Endpoints | None:
        """Return the endpoints with the given addresses, for None the first bulk endpoints; None without endpoints."""
        into, out = self._endpoint(incoming, 0x80), self._endpoint(outgoing, 0)
        if into is None or out is None:
            return None
        return Endpoints(into.bEndpointAddress, _packet_size(into), out.bEndpointAddress, _packet_size(out))

    def _endpoint(self, address: int | None, direction: int) -> Any:
        for endpoint in self.interface:
            if endpoint.bEndpointAddress & 0x80 == direction and (
                endpoint.bmAttributes & 3 == _BULK if address is None else endpoint.bEndpointAddress == address
            ):
                return endpoint
        return None


def _packet_size(endpoint: Any) -> int:
    return endpoint.wMaxPacketSize & 0x7FF or 64


def backend() -> Any:
    """Load libusb from libusb-package. Raise TransportUnavailable, with the package to install."""
    cure = "pip install --force-reinstall pyusb libusb-package"
    try:
        import libusb_package

        found = libusb_package.get_libusb1_backend()
    except Exception as error:
        raise TransportUnavailable(f"usb:// cannot load libusb: {error}; try: {cure}") from error
    if found is None:
        raise TransportUnavailable(f"usb:// cannot find libusb; try: {cure}; or install libusb 1.0 of the system")
    return found


def boards(library: Any, expected: PortIdentity = ANY_DEVICE) -> list[UsbInterface]:
    """Return the fitting interfaces of possible boards; with a driver of the kernel only if `expected` has the ids."""
    found: list[UsbInterface] = []
    devices: Any = usb.core.find(find_all=True, backend=library)
    for device in devices:
        fitting = list(_bulk_interfaces(device, expected.interface))
        # Reading texts may open the device, and is limited to devices that fit otherwise.
        ids = PortIdentity(device.idVendor, device.idProduct, expected.serial_number, expected.interface)
        if fitting and expected.fits(ids):
            serial_number, product = _texts(device)
            found += [
                UsbInterface(
                    device,
                    configuration,
                    interface,
                    PortIdentity(device.idVendor, device.idProduct, serial_number, interface.bInterfaceNumber),
                    product,
                    _driver(device, configuration, interface),
                    exclusive=len(fitting) == 1,
                )
                for configuration, interface in fitting
            ]
    return [
        each for each in found if expected.fits(each.identity) and not (expected.is_any and each.driver not in _FREE)
    ]


def _bulk_interfaces(device: Any, number: int | None) -> Iterator[tuple[Any, Any]]:
    """Yield configuration and interface, with the first fitting alternate setting of each interface."""
    visited = set[tuple[int, int]]()
    with suppress(usb.core.USBError):  # an unplugged device, or damaged descriptors
        for configuration in device:
            for interface in configuration:
                key = configuration.bConfigurationValue, interface.bInterfaceNumber
                if key not in visited and _can_be_board(interface) and number in {None, interface.bInterfaceNumber}:
                    visited.add(key)
                    yield configuration, interface


def _can_be_board(interface: Any) -> bool:
    directions = {each.bEndpointAddress & 0x80 for each in interface if each.bmAttributes & 3 == _BULK}
    return interface.bInterfaceClass == _VENDOR_CLASS and len(directions) == 2


def _description(device: Any) -> Path | None:
    """Return the folder of a device in sysfs on Linux; None if missing."""
    ports = ".".join(map(str, device.port_numbers or ()))
    folder = _DESCRIPTIONS / f"{device.bus}-{ports}"
    return folder if ports and folder.is_dir() else None


def _driver(device: Any, configuration: Any, interface: Any) -> str:
    folder = _description(device)
    if folder is None:
        return ""
    name = f"{folder.name}:{configuration.bConfigurationValue}.{interface.bInterfaceNumber}"
    link = folder / name / "driver"
    return link.resolve().name if link.exists() else ""


def _texts(device: Any) -> tuple[str, str]:
    """Return serial number and product, on Linux without opening the device."""
    if folder := _description(device):
        return _line(folder / "serial"), _line(folder / "product")
    try:
        return _text(device, "serial_number"), _text(device, "product")
    finally:
        usb.util.dispose_resources(device)


def _line(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8", errors="surrogateescape").rstrip("\n")
    except OSError:
        return ""  # no such text, or an unplugged device


def _text(device: Any, name: str) -> str:
    try:
        return getattr(device, name) or ""
    except (usb.core.USBError, ValueError, NotImplementedError):  # ValueError: no permission to read the text
        return ""


def candidates() -> list[DeviceInfo]:
    """Return the possible boards on USB. Raise TransportUnavailable, with the package to install."""
    return [DeviceInfo(each.url, each.product, each.identity, each.problem) for each in boards(backend())]
