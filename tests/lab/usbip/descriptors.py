"""Descriptors of the device: USB 2.0 chapter 9, CDC 1.2 and its PSTN 1.2 subclass, HID 1.11.

A full-speed device, like the microcontrollers on such boards, with three functions for the same board: a serial port
(CDC-ACM), an HID interface with 64-byte reports and no report ids, and a vendor interface with a bulk pair.
"""

from __future__ import annotations

import struct

VENDOR_ID, PRODUCT_ID = 0x1209, 0x0001
"""Vendor and product id reserved by pid.codes for tests, and used by no product."""
VERSION = 0x0100
FULL_SPEED = 2
"""Number of full speed in USB/IP."""
PACKET = 64
"""Size of a packet, and of an HID report, in bytes."""
CONFIGURATION = 1
MISCELLANEOUS = (0xEF, 0x02, 0x01)
"""Class of a device with functions spanning several interfaces."""

CDC_CONTROL, CDC_DATA, HID, VENDOR = range(4)
"""Interface numbers of the device."""
INTERFACE_CLASSES = {
    CDC_CONTROL: (0x02, 0x02, 0x00),
    CDC_DATA: (0x0A, 0x00, 0x00),
    HID: (0x03, 0x00, 0x00),
    VENDOR: (0xFF, 0x00, 0x00),
}
SERIAL_OUT, SERIAL_IN = 0x01, 0x81
SERIAL_NOTIFICATION = 0x82
HID_OUT, HID_IN = 0x03, 0x83
BULK_OUT, BULK_IN = 0x04, 0x84

REPORT = bytes.fromhex(
    "0600ff 0901 a101"  # usage page 0xFF00, usage 1, application collection
    "1500 26ff00 7508 9540"  # values 0 to 255 of 8 bits, 64 of them
    "0902 8102"  # usage 2: input report
    "0903 9102"  # usage 3: output report
    "c0"
)
"""Report descriptor of the HID interface."""

_DEVICE, _CONFIGURATION, _STRING, _INTERFACE, _ENDPOINT, _ASSOCIATION, _CLASS_INTERFACE = 1, 2, 3, 4, 5, 11, 0x24
_HID, _REPORT = 0x21, 0x22
_BULK, _INTERRUPT = 2, 3
_MANUFACTURER, _PRODUCT, _SERIAL_NUMBER = 1, 2, 3
_NAMES = {CDC_CONTROL: (4, "Serial port"), HID: (5, "HID"), VENDOR: (6, "Bulk pair")}
_LANGUAGE = 0x0409  # English (United States)
_SELF_POWERED, _MILLIAMPS = 0xC0, 100
_LONGEST_STRING = 126  # UTF-16 units


def device_descriptors(serial_number: str) -> dict[int, bytes]:
    """Return the descriptors for GET_DESCRIPTOR, by wValue: type and index."""
    texts = {_MANUFACTURER: "servolink", _PRODUCT: "Virtual servo board", _SERIAL_NUMBER: serial_number}
    texts |= dict(_NAMES.values())
    return {
        _DEVICE << 8: _device(),
        _CONFIGURATION << 8: _configuration(),
        _STRING << 8: _descriptor(_STRING, "<H", _LANGUAGE),
        **{_STRING << 8 | index: _text(text) for index, text in texts.items()},
    }


def hid_descriptors() -> dict[int, bytes]:
    """Return the descriptors of the HID interface, by wValue."""
    return {_HID << 8: _hid(), _REPORT << 8: REPORT}


def _descriptor(kind: int, layout: str, *values: int) -> bytes:
    content = struct.pack(layout, *values)
    return bytes((2 + len(content), kind)) + content


def _text(text: str) -> bytes:
    content = text.encode("utf-16-le", "replace")[: 2 * _LONGEST_STRING]
    return bytes((2 + len(content), _STRING)) + content


def _device() -> bytes:
    texts = _MANUFACTURER, _PRODUCT, _SERIAL_NUMBER
    ids = VENDOR_ID, PRODUCT_ID, VERSION
    return _descriptor(_DEVICE, "<H4B3H4B", 0x0200, *MISCELLANEOUS, PACKET, *ids, *texts, 1)


def _configuration() -> bytes:
    functions = _serial() + _interface(HID, 2) + _hid() + _pair(HID_IN, HID_OUT, _INTERRUPT, 1)
    functions += _interface(VENDOR, 2) + _pair(BULK_IN, BULK_OUT, _BULK, 0)
    values = CONFIGURATION, 0, _SELF_POWERED, _MILLIAMPS // 2
    return _descriptor(_CONFIGURATION, "<H5B", 9 + len(functions), len(INTERFACE_CLASSES), *values) + functions


def _serial() -> bytes:
    control_class = INTERFACE_CLASSES[CDC_CONTROL]
    return (
        _descriptor(_ASSOCIATION, "6B", CDC_CONTROL, 2, *control_class, _NAMES[CDC_CONTROL][0])
        + _interface(CDC_CONTROL, 1)
        + _descriptor(_CLASS_INTERFACE, "<BH", 0x00, 0x0110)  # CDC 1.10
        + _descriptor(_CLASS_INTERFACE, "3B", 0x01, 0x00, CDC_DATA)  # no call management
        + _descriptor(_CLASS_INTERFACE, "2B", 0x02, 0x06)  # line coding, control lines and breaks
        + _descriptor(_CLASS_INTERFACE, "3B", 0x06, CDC_CONTROL, CDC_DATA)  # the union of both interfaces
        + _endpoint(SERIAL_NOTIFICATION, _INTERRUPT, 16)
        + _interface(CDC_DATA, 2)
        + _pair(SERIAL_IN, SERIAL_OUT, _BULK, 0)
    )


def _hid() -> bytes:
    return _descriptor(_HID, "<HBBBH", 0x0111, 0, 1, _REPORT, len(REPORT))


def _interface(number: int, endpoints: int) -> bytes:
    name = _NAMES[number][0] if number in _NAMES else 0
    return _descriptor(_INTERFACE, "7B", number, 0, endpoints, *INTERFACE_CLASSES[number], name)


def _pair(into: int, out: int, kind: int, interval: int) -> bytes:
    return _endpoint(into, kind, interval) + _endpoint(out, kind, interval)


def _endpoint(address: int, kind: int, interval: int) -> bytes:
    return _descriptor(_ENDPOINT, "<BBHB", address, kind, PACKET, interval)
