"""Which USB devices have an interface that can be a board's: vendor-defined, with a pair of bulk endpoints."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import usb.core  # type: ignore[import-untyped]
import usb.util  # type: ignore[import-untyped]

from servolink.errors import TransportUnavailable
from servolink.escaping import escape
from servolink.transports.device_info import UDEV_CURE, DeviceInfo, PortIdentity, is_accessible, url_of

_DESCRIPTIONS = Path("/sys/bus/usb/devices")
_NODES = Path("/dev/bus/usb")
_VENDOR_CLASS = 0xFF
_BULK = 2


class Endpoints(NamedTuple):
    """The addresses of two endpoints and the sizes of their packets in bytes."""

    incoming: int
    incoming_size: int
    outgoing: int
    outgoing_size: int


@dataclass(frozen=True, slots=True)
class UsbInterface:
    """An interface that can be a board's; `device`, `configuration` and `interface` are pyusb's."""

    device: Any
    configuration: Any
    interface: Any
    serial_number: str
    product: str
    manufacturer: str
    driver: str  # the kernel's, where that can be seen; "usbfs" is another program
    alone: bool  # whether no other one of its device can be a board's

    @property
    def number(self) -> int:
        """Its number within the device."""
        return int(self.interface.bInterfaceNumber)

    @property
    def url(self) -> str:
        """Its address, with its number where that tells it from others of its device."""
        option = "" if self.alone else f"interface={self.number}"
        return url_of("usb", self.device.idVendor, self.device.idProduct, self.serial_number, option)

    @property
    def problem(self) -> str:
        """Why it cannot be opened, and what to do; empty if nothing is known."""
        node = _NODES / f"{self.device.bus or 0:03d}" / f"{self.device.address or 0:03d}"
        if not is_accessible(str(node)):
            return f"no permission for {node}; {UDEV_CURE}"
        if self.driver == "usbfs":
            return "it is in use by another program; close that"
        return ""

    def endpoints(self, incoming: int | None = None, outgoing: int | None = None) -> Endpoints | None:
        """Return those with the given addresses, or for None the first bulk endpoint of each direction."""
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
    """Load libusb, the one that comes with libusb-package; TransportUnavailable says what to install."""
    cure = "pip install --force-reinstall pyusb libusb-package"
    try:
        import libusb_package

        found = libusb_package.get_libusb1_backend()
    except Exception as error:
        raise TransportUnavailable(f"usb:// cannot load libusb: {escape(str(error))}; try: {cure}") from error
    if found is None:
        raise TransportUnavailable(f"usb:// found no libusb that can be loaded; try: {cure}")
    return found


def boards(library: Any, wanted: PortIdentity | None = None, number: int | None = None) -> list[UsbInterface]:
    """List what can be a board and fits; what a kernel driver uses, as of serial adapters, only if its id is given."""
    wanted = wanted or PortIdentity()
    of_its_kind = replace(wanted, serial_number="")  # the serial number is asked of these only
    found: list[UsbInterface] = []
    devices: Any = usb.core.find(find_all=True, backend=library)
    for device in devices:
        fitting = list(_bulk_interfaces(device, number))
        if fitting and of_its_kind.fits(device.idVendor, device.idProduct, ""):
            serial_number, product, manufacturer = _texts(device)
            if wanted.fits(device.idVendor, device.idProduct, serial_number):
                found += [
                    UsbInterface(
                        device,
                        configuration,
                        interface,
                        serial_number,
                        product,
                        manufacturer,
                        _driver(device, configuration, interface),
                        alone=len(fitting) == 1,
                    )
                    for configuration, interface in fitting
                ]
    return [each for each in found if not wanted.is_any or each.driver in {"", "usbfs"}]


def _bulk_interfaces(device: Any, number: int | None) -> Iterator[tuple[Any, Any]]:
    """Yield configuration and interface, the first fitting alternate setting of each."""
    seen = set[tuple[int, int]]()
    with suppress(usb.core.USBError):  # a device that has just vanished, or whose descriptors are damaged
        for configuration in device:
            for interface in configuration:
                key = configuration.bConfigurationValue, interface.bInterfaceNumber
                if key not in seen and _can_be_board(interface) and number in {None, interface.bInterfaceNumber}:
                    seen.add(key)
                    yield configuration, interface


def _can_be_board(interface: Any) -> bool:
    directions = {each.bEndpointAddress & 0x80 for each in interface if each.bmAttributes & 3 == _BULK}
    return interface.bInterfaceClass == _VENDOR_CLASS and len(directions) == 2


def _description(device: Any) -> Path | None:
    """Return the folder in which Linux describes a device, if there is one."""
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


def _texts(device: Any) -> tuple[str, str, str]:
    """Return serial number, product and manufacturer, on Linux without opening the device."""
    if folder := _description(device):
        return _line(folder / "serial"), _line(folder / "product"), _line(folder / "manufacturer")
    try:
        return tuple(_text(device, name) for name in ("serial_number", "product", "manufacturer"))  # type: ignore[return-value]
    finally:
        usb.util.dispose_resources(device)


def _line(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8", errors="surrogateescape").rstrip("\n")
    except OSError:
        return ""  # the device has no such text, or has vanished


def _text(device: Any, name: str) -> str:
    try:
        return getattr(device, name) or ""
    except (usb.core.USBError, ValueError, NotImplementedError):  # ValueError: no permission to ask for it
        return ""


def candidates() -> list[DeviceInfo]:
    """List the USB interfaces that can be a board's; TransportUnavailable says what to install."""
    return [DeviceInfo(each.url, each.product, each.serial_number, each.problem) for each in boards(backend())]
