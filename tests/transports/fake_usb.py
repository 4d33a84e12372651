"""A board where libusb would find one, under the real pyusb, which can be unplugged, stuck and halted at any time."""

from __future__ import annotations

import errno
import threading
from array import array
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import usb.core  # type: ignore[import-untyped]

import servolink.transports.usb
from servolink.transports import usb_devices

PACKET = 64
HASTE = 50.0  # waiting for nothing takes this much less time than on a real device
IN, OUT = 0x81, 0x01
STRINGS = {1: "Acme", 2: "Servo board", 3: "SN 1"}


def plugged_in(monkeypatch: pytest.MonkeyPatch, folder: Path) -> Iterator[FakeUsb]:
    """Put a board where libusb is searched for, without descriptions by Linux, and check that it is released."""
    board = FakeUsb()
    monkeypatch.setattr(servolink.transports.usb, "backend", lambda: board)
    monkeypatch.setattr(usb_devices, "backend", lambda: board)
    monkeypatch.setattr(usb_devices, "_DESCRIPTIONS", folder / "sys")
    monkeypatch.setattr(usb_devices, "_NODES", folder / "dev")
    yield board
    assert board.handles == set()
    assert board.claimed == set()
    assert board.misuse == []


def failure(number: int, text: str = "failed") -> usb.core.USBError:
    return usb.core.USBError(text, -1, number)


def bulk_pair(number: int = 0, incoming: int = IN, outgoing: int = OUT, **changes: Any) -> SimpleNamespace:
    """Describe an interface as a board has it."""
    return SimpleNamespace(
        **{
            "bInterfaceNumber": number,
            "bAlternateSetting": 0,
            "bInterfaceClass": 0xFF,
            "endpoints": [endpoint(incoming), endpoint(outgoing)],
            **changes,
        }
    )


def endpoint(address: int, kind: int = 2) -> SimpleNamespace:
    return SimpleNamespace(bEndpointAddress=address, bmAttributes=kind, wMaxPacketSize=PACKET)


class FakeUsb:
    """Stands for libusb and for the one device it has; the far end is in the test's hand."""

    def __init__(self, *interfaces: SimpleNamespace) -> None:
        self.interfaces = list(interfaces) or [bulk_pair()]
        self.product_id = 0x0001
        self.serial_index = 3
        self.heard: Callable[[bytes], None] = lambda data: None  # called with each transfer that the board takes
        self.change = threading.Condition()
        self.packets: deque[bytes] = deque()
        self.there = True
        self.haste = HASTE
        self.count = 1  # such devices
        self.deaf = False
        self.read_stuck = False
        self.read_is_stuck = False  # whether one is by now
        self.write_is_stuck = False
        self.write_stuck = False
        self.part: int | None = None  # bytes that the next write takes before its time is over
        self.halted: set[int] = set()
        self.configuration = 1
        self.driver = False  # whether the kernel has one on the interface
        self.open_failure: Exception | None = None
        self.claim_failure: Exception | None = None
        self.handles: set[object] = set()  # the open ones
        self.claimed: set[int] = set()
        self.calls: list[str] = []
        self.misuse: list[str] = []
        self._busy: list[object] = []  # the handles of the transfers under way

    def bring(self, *packets: bytes) -> None:
        """Send packets to the program."""
        with self.change:
            self.packets.extend(packets)
            self.change.notify_all()

    def set(self, **states: Any) -> None:
        """Change how the board behaves, also for calls that are under way."""
        with self.change:
            self.__dict__.update(states)
            self.change.notify_all()

    def unplug(self) -> None:
        self.set(there=False, deaf=False, read_stuck=False, write_stuck=False)

    def enumerate_devices(self) -> list[int]:
        return list(range(self.count)) if self.there else []

    def get_device_descriptor(self, dev: int) -> SimpleNamespace:
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=1,
            bcdUSB=0x0200,
            bDeviceClass=0,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=64,
            idVendor=0x1209,
            idProduct=self.product_id,
            bcdDevice=0x0100,
            iManufacturer=1,
            iProduct=2,
            iSerialNumber=self.serial_index,
            bNumConfigurations=1,
            address=7 + dev,
            bus=1,
            port_number=2,
            port_numbers=(1, 2),
            speed=2,
        )

    def get_configuration_descriptor(self, dev: int, config: int) -> SimpleNamespace:
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=2,
            wTotalLength=32,
            bNumInterfaces=len({each.bInterfaceNumber for each in self.interfaces}),
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0x80,
            bMaxPower=50,
            extra_descriptors=[],
        )

    def get_interface_descriptor(self, dev: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        if not self.there:
            raise failure(errno.ENODEV)
        numbers = sorted({each.bInterfaceNumber for each in self.interfaces})
        found = [each for each in self.interfaces if each.bInterfaceNumber == numbers[intf]][alt]
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=4,
            bNumEndpoints=len(found.endpoints),
            bInterfaceSubClass=0,
            bInterfaceProtocol=0,
            iInterface=0,
            extra_descriptors=[],
            **vars(found),
        )

    def get_endpoint_descriptor(self, dev: int, ep: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        found = self.get_interface_descriptor(dev, intf, alt, config).endpoints[ep]
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=5,
            bInterval=0,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=[],
            **vars(found),
        )

    def open_device(self, dev: int) -> object:
        self._look()
        if self.open_failure is not None:
            raise self.open_failure
        handle = object()
        self.handles.add(handle)
        return handle

    def close_device(self, dev_handle: object) -> None:
        if dev_handle in self._busy:
            self.misuse.append("closed during a transfer")
        self.handles.remove(dev_handle)

    def get_configuration(self, dev_handle: object) -> int:
        return self.configuration

    def set_configuration(self, dev_handle: object, config_value: int) -> None:
        self.calls.append(f"set_configuration {config_value}")
        self.configuration = config_value

    def set_interface_altsetting(self, dev_handle: object, intf: int, altsetting: int) -> None:
        self.calls.append(f"set_interface_altsetting {intf} {altsetting}")

    def claim_interface(self, dev_handle: object, intf: int) -> None:
        self._look()
        if self.claim_failure is not None:
            raise self.claim_failure
        if self.driver or intf in self.claimed:
            raise failure(errno.EBUSY)
        self.claimed.add(intf)

    def release_interface(self, dev_handle: object, intf: int) -> None:
        self.claimed.discard(intf)
        self._look()

    def is_kernel_driver_active(self, dev_handle: object, intf: int) -> bool:
        self._look()
        return self.driver

    def detach_kernel_driver(self, dev_handle: object, intf: int) -> None:
        self.driver = False

    def attach_kernel_driver(self, dev_handle: object, intf: int) -> None:
        self._look()
        if intf in self.claimed:
            raise failure(errno.EBUSY)
        self.driver = True

    def clear_halt(self, dev_handle: object, ep: int) -> None:
        self._look()
        self.calls.append(f"clear_halt {ep:#04x}")
        self.halted.discard(ep)

    def ctrl_transfer(self, handle: object, kind: int, request: int, value: int, index: int, data: Any, ms: int) -> int:
        """Answer GET_DESCRIPTOR for strings."""
        self._look()
        body = STRINGS[value & 0xFF].encode("utf-16-le") if value & 0xFF else b"\x09\x04"
        answer = bytes([2 + len(body), 3]) + body
        data[: len(answer)] = array("B", answer)
        return len(answer)

    def bulk_read(self, dev_handle: object, ep: int, intf: int, buff: array[int], timeout: int) -> int:
        if timeout < 250 or len(buff) % PACKET or dev_handle not in self.handles:
            self.misuse.append(f"read of {len(buff)} bytes within {timeout} ms")
        with self.change:
            self._busy.append(dev_handle)
            self.change.wait_for(
                lambda: not self.there or ep in self.halted or bool(self.packets and not self.read_stuck),
                timeout / 1000 / self.haste,
            )
            self.read_is_stuck = self.read_stuck
            self.change.wait_for(lambda: not self.read_stuck)
            self._busy.remove(dev_handle)
            self._look(ep)
            if not self.packets:
                raise usb.core.USBTimeoutError("timed out", -7, errno.ETIMEDOUT)
            packet = self.packets.popleft()
            if len(packet) > len(buff):
                raise failure(errno.EOVERFLOW)
            buff[: len(packet)] = array("B", packet)
            return len(packet)

    def bulk_write(self, dev_handle: object, ep: int, intf: int, data: array[int], timeout: int) -> int:
        if timeout < 250 or dev_handle not in self.handles:
            self.misuse.append(f"write within {timeout} ms")
        with self.change:
            self._busy.append(dev_handle)
            self.change.wait_for(lambda: not self.deaf or self.part is not None, timeout / 1000 / self.haste)
            self.write_is_stuck = self.write_stuck
            self.change.wait_for(lambda: not self.write_stuck)
            self._busy.remove(dev_handle)
            self._look(ep)
            if self.deaf and self.part is None:
                raise usb.core.USBTimeoutError("timed out", -7, errno.ETIMEDOUT)
            taken = bytes(data) if self.part is None else bytes(data)[: self.part]
            self.part = None
        self.heard(taken)
        return len(taken)

    intr_read = iso_read = bulk_read  # pyusb looks all of them up
    intr_write = iso_write = bulk_write

    def _look(self, ep: int | None = None) -> None:
        """Fail as a device that is gone, or whose endpoint is halted."""
        if not self.there:
            raise failure(errno.ENODEV, "No such device (it may have been disconnected)")
        if ep in self.halted:
            raise failure(errno.EPIPE, "Pipe error")
