"""From an address to the files of its device under Linux."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePosixPath

from servolink.doctor.facts import SystemFacts
from servolink.transports.address import Address
from servolink.transports.usb_id import UsbId

USB_DEVICES = "/sys/bus/usb/devices"


@dataclass(frozen=True, slots=True)
class UsbDevice:
    """A USB device as the system describes it; its texts come from the device itself."""

    folder: str
    vendor_id: int
    product_id: int
    serial_number: str
    product: str


def device_of(url: str) -> str:
    """Return the device file or COM port of a serial port's address; empty for other addresses."""
    address = Address.parse(url)
    return address.host + address.path if address.scheme == "serial" else ""


def device_nodes(facts: SystemFacts, url: str) -> list[str]:
    """Return the device files that have to be opened for `url`."""
    if device := device_of(url):
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


def usb_device(facts: SystemFacts, url: str) -> UsbDevice | None:
    """Return the USB device that `url` leads to, if it is one."""
    if device := device_of(url):
        return _usb_parent(facts, f"/sys/class/tty/{PurePosixPath(facts.real(device)).name}/device")
    if Address.parse(url).scheme in {"hid", "usb"}:
        return next((device for device in usb_devices(facts) if _is_meant(url, device)), None)
    return None


def usb_devices(facts: SystemFacts) -> Iterator[UsbDevice]:
    """Yield what is plugged in."""
    for name in facts.names(USB_DEVICES):
        if (device := _described(facts, facts.real(f"{USB_DEVICES}/{name}"))) is not None:
            yield device


def named_usb_device(url: str) -> UsbDevice | None:
    """Return the USB device that `url` itself describes, plugged in or not; None if it names no ids."""
    address = Address.parse(url)
    if address.scheme not in {"hid", "usb"}:
        return None
    named = UsbId.of(address)
    if named.vendor_id is None or named.product_id is None:
        return None
    return UsbDevice("", named.vendor_id, named.product_id, named.serial_number, "")


def _usb_parent(facts: SystemFacts, path: str) -> UsbDevice | None:
    """Return the USB device above a file of the system's device tree."""
    above = PurePosixPath(facts.real(path))
    return next(
        (device for folder in (above, *above.parents) if (device := _described(facts, str(folder))) is not None), None
    )


def _described(facts: SystemFacts, folder: str) -> UsbDevice | None:
    try:
        vendor_id = int(facts.text(f"{folder}/idVendor"), 16)
        product_id = int(facts.text(f"{folder}/idProduct"), 16)
    except ValueError:
        return None
    return UsbDevice(folder, vendor_id, product_id, facts.text(f"{folder}/serial"), facts.text(f"{folder}/product"))


def _is_meant(url: str, device: UsbDevice) -> bool:
    wanted = UsbId.of(Address.parse(url))
    return not wanted.is_any and wanted.fits(device.vendor_id, device.product_id, device.serial_number)
