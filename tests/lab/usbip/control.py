"""Endpoint 0: standard requests of USB, and class requests of serial and HID interfaces."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Self, TypeAlias

from tests.lab.usbip.descriptors import (
    CDC_CONTROL,
    CONFIGURATION,
    HID,
    INTERFACE_CLASSES,
    PACKET,
    device_descriptors,
    hid_descriptors,
)
from tests.lab.usbip.endpoint import Endpoint

STALL = None
"""Response to a request unknown to the device."""
_OK = b""
_TO_DEVICE, _TO_INTERFACE, _TO_ENDPOINT = range(3)
_FROM_DEVICE, _FROM_INTERFACE, _FROM_ENDPOINT = range(0x80, 0x83)
_KIND, _CLASS = 0x60, 0x20  # bits to distinguish standard requests from class requests
_GET_STATUS, _CLEAR_FEATURE, _SET_FEATURE = 0, 1, 3
_GET_DESCRIPTOR, _GET_CONFIGURATION, _SET_CONFIGURATION, _GET_INTERFACE, _SET_INTERFACE = 6, 8, 9, 10, 11
_ENDPOINT_HALT = 0
_SELF_POWERED = b"\1\0"
_INPUT, _OUTPUT = 1, 2  # types of reports


@dataclass(frozen=True, slots=True)
class Setup:
    """Setup packet: the first eight bytes of a control transfer."""

    kind: int
    """Field bmRequestType: direction, standard or class, and recipient."""
    request: int
    value: int
    index: int
    length: int

    @classmethod
    def parse(cls, data: bytes) -> Self:
        """Return the setup packet in eight bytes."""
        return cls(*struct.unpack("<BBHHH", data))


Handler: TypeAlias = Callable[[Setup, bytes], bytes | None]


class ControlEndpoint:
    """Responder to control requests. Values set by the host are stored and returned, without other effects."""

    def __init__(
        self, serial_number: str, endpoints: Mapping[int, Endpoint], take_report: Callable[[bytes], None]
    ) -> None:
        """Serve a device with `endpoints`, by address, and pass output reports to `take_report`."""
        self._descriptors = device_descriptors(serial_number)
        self._hid_descriptors = hid_descriptors()
        self._endpoints = endpoints
        self._take_report = take_report
        self._configuration = b"\0"
        self._line_coding = struct.pack("<IBBB", 115200, 0, 0, 8)
        self._idle = b"\0"
        self._protocol = b"\1"  # report protocol, not boot protocol
        self._standard: dict[tuple[int, int], Handler] = {
            (_FROM_DEVICE, _GET_STATUS): lambda *_: _SELF_POWERED,
            (_FROM_INTERFACE, _GET_STATUS): lambda *_: b"\0\0",
            (_FROM_ENDPOINT, _GET_STATUS): self._endpoint_status,
            (_TO_ENDPOINT, _CLEAR_FEATURE): self._clear_halt,
            (_TO_ENDPOINT, _SET_FEATURE): self._halt,
            (_FROM_DEVICE, _GET_DESCRIPTOR): lambda setup, _: self._descriptors.get(setup.value),
            (_FROM_INTERFACE, _GET_DESCRIPTOR): self._interface_descriptor,
            (_FROM_DEVICE, _GET_CONFIGURATION): lambda *_: self._configuration,
            (_TO_DEVICE, _SET_CONFIGURATION): self._set_configuration,
            (_FROM_INTERFACE, _GET_INTERFACE): lambda setup, _: b"\0" if setup.index in INTERFACE_CLASSES else STALL,
            (_TO_INTERFACE, _SET_INTERFACE): self._set_interface,
        }
        self._of_class: dict[int, dict[tuple[int, int], Handler]] = {
            CDC_CONTROL: {
                (_TO_INTERFACE, 0x20): self._set_line_coding,
                (_FROM_INTERFACE, 0x21): lambda *_: self._line_coding,
                (_TO_INTERFACE, 0x22): lambda *_: _OK,  # DTR and RTS: the board responds in any case
                (_TO_INTERFACE, 0x23): lambda *_: _OK,  # a break
            },
            HID: {
                (_FROM_INTERFACE, 0x01): lambda setup, _: bytes(PACKET) if setup.value == _INPUT << 8 else STALL,
                (_FROM_INTERFACE, 0x02): lambda *_: self._idle,
                (_FROM_INTERFACE, 0x03): lambda *_: self._protocol,
                (_TO_INTERFACE, 0x09): self._set_report,
                (_TO_INTERFACE, 0x0A): self._set_idle,
                (_TO_INTERFACE, 0x0B): self._set_protocol,
            },
        }

    def respond(self, setup: bytes, data: bytes) -> bytes | None:
        """Return the data for a request, perhaps empty, or STALL for a request unknown to the device."""
        request = Setup.parse(setup)
        of_class = request.kind & _KIND == _CLASS
        handlers = self._of_class.get(request.index, {}) if of_class else self._standard
        handler = handlers.get((request.kind & ~_KIND if of_class else request.kind, request.request))
        response = STALL if handler is None else handler(request, data)
        return None if response is None else response[: request.length]

    def _endpoint_status(self, setup: Setup, _: bytes) -> bytes | None:
        endpoint = self._endpoints.get(setup.index)
        return STALL if endpoint is None else bytes((endpoint.halted, 0))

    def _clear_halt(self, setup: Setup, _: bytes) -> bytes | None:
        endpoint = self._endpoints.get(setup.index)
        if endpoint is None or setup.value != _ENDPOINT_HALT:
            return STALL
        endpoint.clear_halt()
        return _OK

    def _halt(self, setup: Setup, _: bytes) -> bytes | None:
        endpoint = self._endpoints.get(setup.index)
        if endpoint is None or setup.value != _ENDPOINT_HALT:
            return STALL
        endpoint.halt()
        return _OK

    def _interface_descriptor(self, setup: Setup, _: bytes) -> bytes | None:
        return self._hid_descriptors.get(setup.value) if setup.index == HID else STALL

    def _set_configuration(self, setup: Setup, _: bytes) -> bytes | None:
        if setup.value not in {0, CONFIGURATION}:
            return STALL
        self._configuration = bytes((setup.value,))
        for endpoint in self._endpoints.values():
            endpoint.clear_halt()
        return _OK

    def _set_interface(self, setup: Setup, _: bytes) -> bytes | None:
        return _OK if setup.index in INTERFACE_CLASSES and setup.value == 0 else STALL

    def _set_line_coding(self, _: Setup, data: bytes) -> bytes | None:
        if len(data) != len(self._line_coding):
            return STALL
        self._line_coding = data
        return _OK

    def _set_report(self, setup: Setup, data: bytes) -> bytes | None:
        if setup.value != _OUTPUT << 8:
            return STALL
        self._take_report(data)
        return _OK

    def _set_idle(self, setup: Setup, _: bytes) -> bytes | None:
        self._idle = bytes((setup.value >> 8,))
        return _OK

    def _set_protocol(self, setup: Setup, _: bytes) -> bytes | None:
        self._protocol = bytes((setup.value & 1,))
        return _OK
