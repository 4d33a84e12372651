"""The USB device, URB by URB, without a line to a host."""

from __future__ import annotations

import struct
from typing import NamedTuple

import pytest

from servolink.errors import DecodeError
from tests.lab.usbip.descriptors import (
    BULK_IN,
    BULK_OUT,
    HID_IN,
    HID_OUT,
    PACKET,
    REPORT,
    SERIAL_IN,
    SERIAL_NOTIFICATION,
    SERIAL_OUT,
)
from tests.lab.usbip.device import MAX_UNREAD, MAX_WAITING, UsbDevice, reports, transfers
from tests.lab.usbip.endpoint import DONE, NO_RESPONSE, OVERFLOW, STALLED, UNLINKED, Urb

BOTH = pytest.mark.parametrize(
    ("name", "out", "into"), [("serial", SERIAL_OUT, SERIAL_IN), ("bulk", BULK_OUT, BULK_IN)]
)
TEXT = bytes(range(256))


class Done(NamedTuple):
    number: int
    status: int
    received: bytes
    moved: int


class Bus:
    """A device, and what it has given back."""

    def __init__(self, serial_number: str = "virtual-1") -> None:
        self.device = UsbDevice(serial_number, self._complete)
        self.done: list[Done] = []
        self._number = 0

    def _complete(self, urb: Urb, status: int) -> None:
        self.done.append(Done(urb.number, status, bytes(urb.received), urb.moved))

    def read(self, endpoint: int, length: int) -> int:
        self._number += 1
        self.device.submit(Urb(self._number, endpoint, length))
        return self._number

    def write(self, endpoint: int, data: bytes) -> int:
        self._number += 1
        self.device.submit(Urb(self._number, endpoint, len(data), data=data))
        return self._number

    def control(
        self, kind: int, request: int, value: int = 0, index: int = 0, length: int = 0, data: bytes = b""
    ) -> Done:
        self._number += 1
        setup = struct.pack("<BBHHH", kind, request, value, index, length or len(data))
        self.device.submit(Urb(self._number, kind & 0x80, length or len(data), setup, data))
        return self.done.pop()

    def statuses(self) -> dict[int, int]:
        return {done.number: done.status for done in self.done}


# Data towards the host


@BOTH
def test_a_transfer_ends_with_a_packet_that_is_not_full(name: str, out: int, into: int) -> None:
    bus = Bus()
    for size in (1, 63, 64, 65, 128, 200):
        getattr(bus.device, name).send(TEXT[:size])
        bus.read(into, 1024)
        assert bus.done.pop() == Done(bus._number, DONE, TEXT[:size], size)
    assert not bus.device.outstanding


def test_a_read_of_exactly_the_packets_leaves_the_empty_one_for_the_next() -> None:
    bus = Bus()
    bus.device.bulk.send(TEXT[:64])
    bus.read(BULK_IN, 64)
    bus.read(BULK_IN, 64)
    assert [done.received for done in bus.done] == [TEXT[:64], b""]


def test_reads_wait_until_there_is_data_and_are_served_in_turn() -> None:
    bus = Bus()
    first, second = bus.read(BULK_IN, 512), bus.read(BULK_IN, 512)
    assert bus.device.outstanding == 2
    bus.device.bulk.send(b"one")
    assert bus.done == [Done(first, DONE, b"one", 3)]
    bus.device.bulk.send(b"two")
    assert bus.done[1:] == [Done(second, DONE, b"two", 3)]


def test_a_packet_that_does_not_fit_is_lost_and_told_as_overflow() -> None:
    bus = Bus()
    bus.device.bulk.send(TEXT[:64])
    bus.read(BULK_IN, 10)
    bus.read(BULK_IN, 64)
    assert [done.status for done in bus.done] == [OVERFLOW, DONE]
    assert [done.received for done in bus.done] == [b"", b""]


def test_an_overflow_keeps_the_packets_that_did_fit() -> None:
    bus = Bus()
    bus.device.bulk.send(TEXT[:128])
    bus.read(BULK_IN, 100)
    assert bus.done == [Done(1, OVERFLOW, TEXT[:64], 64)]


def test_reports_are_padded_and_each_is_a_transfer() -> None:
    bus = Bus()
    bus.device.hid.send(TEXT[:70])
    bus.read(HID_IN, 64)
    bus.read(HID_IN, 64)
    assert [done.received for done in bus.done] == [TEXT[:64], TEXT[64:70] + bytes(58)]


def test_what_the_host_leaves_unread_is_bounded_and_what_is_sent_stays_whole() -> None:
    bus = Bus()
    for _ in range(2 * MAX_WAITING // 1000):
        bus.device.bulk.send(bytes(1000))
    assert MAX_WAITING - 1000 <= bus.device.bulk.to_host.waiting <= MAX_WAITING
    frames = 0
    while bus.device.bulk.to_host.waiting:
        bus.read(BULK_IN, 4096)
        assert len(bus.done.pop().received) == 1000
        frames += 1
    assert frames == MAX_WAITING // 1000


@pytest.mark.parametrize("size", [0, 1, 63, 64, 65, 128])
def test_cutting_keeps_every_byte(size: int) -> None:
    data = TEXT[:size]
    assert b"".join(transfers(data)) == data
    assert len(transfers(data)[-1]) < PACKET
    assert b"".join(reports(data)).startswith(data)
    assert {len(report) for report in reports(data)} <= {PACKET}


# Data from the host


@BOTH
def test_writes_are_taken_at_once_and_given_back_before_the_answer(name: str, out: int, into: int) -> None:
    bus = Bus()
    pipe = getattr(bus.device, name)
    pipe.receive = pipe.send  # echo
    read = bus.read(into, 512)
    write = bus.write(out, b"hello")
    assert bus.done == [Done(write, DONE, b"", 5), Done(read, DONE, b"hello", 5)]


def test_a_long_write_arrives_whole_and_in_order() -> None:
    bus, heard = Bus(), bytearray()
    bus.device.hid.receive = heard.extend
    data = TEXT * 40
    bus.write(HID_OUT, data)
    assert bytes(heard) == data
    assert bus.done == [Done(1, DONE, b"", len(data))]


def test_an_empty_write_is_done_and_tells_nothing() -> None:
    bus, heard = Bus(), bytearray()
    bus.device.bulk.receive = heard.extend
    bus.write(BULK_OUT, b"")
    assert bus.done == [Done(1, DONE, b"", 0)]
    assert not heard


def test_a_host_that_does_not_read_is_not_heard_until_it_does() -> None:
    bus, heard = Bus(), bytearray()

    def answer(data: bytes) -> None:
        heard.extend(data)
        bus.device.bulk.send(bytes(9000))

    bus.device.bulk.receive = answer
    write = bus.write(BULK_OUT, TEXT * 16)
    unheard = bus.device.pending_bytes
    assert not bus.done
    assert 0 < unheard == len(TEXT) * 16 - len(heard)
    assert bus.device.bulk.to_host.waiting < MAX_UNREAD + 9000
    while bus.device.pending_bytes:
        bus.read(BULK_IN, 65536)
    assert bytes(heard) == TEXT * 16
    assert bus.statuses()[write] == DONE


# Taking URBs back, halts, endpoints


def test_an_unlinked_urb_is_not_given_back() -> None:
    bus = Bus()
    read = bus.read(BULK_IN, 64)
    assert bus.device.unlink(read) == UNLINKED
    bus.device.bulk.send(b"late")
    assert not bus.done
    assert bus.device.unlink(read) == DONE  # as for any URB that is no longer outstanding
    bus.read(BULK_IN, 64)
    assert [done.received for done in bus.done] == [b"late"]


def test_an_unlinked_urb_that_has_moved_some_bytes_brings_them() -> None:
    bus = Bus()
    read = bus.read(BULK_IN, 1024)
    bus.device.bulk.to_host.send([TEXT[:64]])
    assert bus.device.unlink(read) == DONE
    assert bus.done == [Done(read, UNLINKED, TEXT[:64], 64)]


def test_a_write_that_waits_can_be_unlinked() -> None:
    bus = Bus()
    bus.device.bulk.send(bytes(MAX_UNREAD))
    write = bus.write(BULK_OUT, b"never")
    assert bus.device.unlink(write) == UNLINKED
    assert bus.device.pending_bytes == bus.device.outstanding == 0


def test_a_halted_endpoint_stalls_what_waits_and_what_comes_until_the_host_clears_it() -> None:
    bus = Bus()
    waiting = bus.read(BULK_IN, 64)
    bus.device.halt(BULK_IN)
    later = bus.read(BULK_IN, 64)
    bus.device.bulk.send(b"kept")
    assert bus.statuses() == {waiting: STALLED, later: STALLED}
    assert bus.control(0x82, 0x00, index=BULK_IN, length=2).received == b"\1\0"
    assert bus.control(0x02, 0x01, index=BULK_IN).status == DONE
    assert bus.control(0x82, 0x00, index=BULK_IN, length=2).received == b"\0\0"
    bus.read(BULK_IN, 64)
    assert bus.done[-1].received == b"kept"


def test_the_host_can_halt_an_endpoint_too() -> None:
    bus = Bus()
    assert bus.control(0x02, 0x03, index=BULK_OUT).status == DONE
    bus.write(BULK_OUT, b"x")
    assert bus.done.pop().status == STALLED
    assert bus.control(0x00, 0x09, value=1).status == DONE  # configuring ends halts
    bus.write(BULK_OUT, b"x")
    assert bus.done.pop().status == DONE


def test_nobody_answers_on_an_endpoint_that_does_not_exist() -> None:
    bus = Bus()
    bus.read(0x8F, 64)
    bus.write(0x0F, b"x")
    assert [done.status for done in bus.done] == [NO_RESPONSE, NO_RESPONSE]


def test_the_serial_port_never_notifies() -> None:
    bus = Bus()
    bus.read(SERIAL_NOTIFICATION, 16)
    bus.device.serial.send(b"data")
    assert not bus.done


def test_a_number_is_used_by_one_urb_at_a_time() -> None:
    bus = Bus()
    bus.device.submit(Urb(7, BULK_IN, 64))
    with pytest.raises(DecodeError, match="7"):
        bus.device.submit(Urb(7, BULK_IN, 64))


# Control requests


def test_the_device_descriptor_tells_the_test_id_and_that_functions_span_interfaces() -> None:
    device = Bus().control(0x80, 0x06, 0x0100, length=64).received
    assert len(device) == device[0] == 18
    assert struct.unpack_from("<H", device, 2) == (0x0200,)
    assert device[4:8] == bytes((0xEF, 0x02, 0x01, 64))
    assert struct.unpack_from("<HH", device, 8) == (0x1209, 0x0001)


def test_the_configuration_consists_of_whole_descriptors() -> None:
    bus = Bus()
    head = bus.control(0x80, 0x06, 0x0200, length=9).received
    whole = bus.control(0x80, 0x06, 0x0200, length=0xFF).received
    assert struct.unpack_from("<H", head, 2) == (len(whole),)
    assert whole.startswith(head)
    kinds: list[int] = []
    endpoints: list[int] = []
    interfaces: dict[int, tuple[int, int]] = {}
    while whole:
        kinds.append(whole[1])
        if whole[1] == 4:
            interfaces[whole[2]] = (whole[4], whole[5])
        if whole[1] == 5:
            endpoints.append(whole[2])
        whole = whole[whole[0] :]
    assert (kinds.count(4), kinds.count(5), kinds.count(11)) == (4, 7, 1)
    assert interfaces == {0: (1, 0x02), 1: (2, 0x0A), 2: (2, 0x03), 3: (2, 0xFF)}
    assert sorted(endpoints) == [SERIAL_OUT, HID_OUT, BULK_OUT, SERIAL_IN, SERIAL_NOTIFICATION, HID_IN, BULK_IN]


@pytest.mark.parametrize("serial_number", ["virtual-7", "", "x" * 1000, "\N{SNOWMAN}"])
def test_strings_tell_product_and_serial_number(serial_number: str) -> None:
    bus = Bus(serial_number)
    indexes = bus.control(0x80, 0x06, 0x0100, length=18).received[14:17]
    texts = [bus.control(0x80, 0x06, 0x0300 | index, 0x0409, 255).received for index in indexes]
    assert all(text[0] == len(text) and text[1] == 3 for text in texts)
    assert [text[2:].decode("utf-16-le") for text in texts] == ["servolink", "Virtual servo board", serial_number[:126]]
    assert bus.control(0x80, 0x06, 0x0300, length=255).received == bytes((4, 3, 0x09, 0x04))


def test_the_hid_interface_tells_its_reports() -> None:
    bus = Bus()
    descriptor = bus.control(0x81, 0x06, 0x2200, 2, 255).received
    assert descriptor == REPORT
    assert descriptor.startswith(bytes.fromhex("0600ff"))  # usage page 0xFF00
    assert b"\x85" not in descriptor[::2]  # no report ids
    assert struct.unpack_from("<H", bus.control(0x81, 0x06, 0x2100, 2, 9).received, 7) == (len(descriptor),)


@pytest.mark.parametrize(
    ("kind", "request_", "value", "index"),
    [
        (0x80, 0x06, 0x0600, 0),  # the qualifier, which a device has that can also be faster
        (0x80, 0x06, 0x0F00, 0),  # BOS
        (0x80, 0x06, 0x03EE, 0),
        (0x81, 0x06, 0x2200, 0),  # the serial port has no reports
        (0x00, 0x09, 2, 0),  # there is no second configuration
        (0x01, 0x0B, 1, 3),  # nor other settings of an interface
        (0x81, 0x0A, 0, 9),
        (0x82, 0x00, 0, 0x8F),
        (0x02, 0x01, 0, 0x8F),
        (0x02, 0x03, 1, BULK_IN),
        (0xA1, 0x01, 0x0300, 2),  # a feature report
        (0x21, 0x09, 0x0300, 2),
        (0x21, 0x20, 0, 0),  # a line coding of no bytes
        (0x21, 0x20, 0, 3),
        (0xC0, 0x01, 0, 0),  # the vendor's
    ],
)
def test_what_the_device_does_not_know_it_stalls(kind: int, request_: int, value: int, index: int) -> None:
    bus = Bus()
    assert bus.control(kind, request_, value, index, length=64 if kind & 0x80 else 0).status == STALLED
    assert bus.control(0x80, 0x00, length=2).received == b"\1\0"  # a stall of endpoint 0 is over with the request


def test_standard_requests_give_back_what_was_set() -> None:
    bus = Bus()
    assert bus.control(0x80, 0x08, length=1).received == b"\0"
    assert bus.control(0x00, 0x09, value=1).status == DONE
    assert bus.control(0x80, 0x08, length=1).received == b"\1"
    assert bus.control(0x01, 0x0B, value=0, index=1).status == DONE
    assert bus.control(0x81, 0x0A, index=1, length=1).received == b"\0"
    assert bus.control(0x81, 0x00, length=2).received == b"\0\0"


def test_the_serial_port_keeps_its_line_coding_and_takes_control_lines_and_breaks() -> None:
    bus = Bus()
    assert bus.control(0xA1, 0x21, length=7).received == struct.pack("<IBBB", 115200, 0, 0, 8)
    coding = struct.pack("<IBBB", 9600, 2, 1, 7)
    assert bus.control(0x21, 0x20, data=coding).moved == 7
    assert bus.control(0xA1, 0x21, length=7).received == coding
    assert bus.control(0x21, 0x22, value=3).status == DONE
    assert bus.control(0x21, 0x23, value=100).status == DONE


def test_the_hid_interface_takes_reports_by_the_control_pipe_too() -> None:
    bus, heard = Bus(), bytearray()
    bus.device.hid.receive = heard.extend
    assert bus.control(0x21, 0x09, 0x0200, 2, data=TEXT[:64]).status == DONE
    assert bytes(heard) == TEXT[:64]
    assert bus.control(0xA1, 0x01, 0x0100, 2, 64).received == bytes(64)


def test_the_hid_interface_keeps_idle_rate_and_protocol() -> None:
    bus = Bus()
    assert bus.control(0xA1, 0x03, 0, 2, 1).received == b"\1"
    assert bus.control(0x21, 0x0A, 0x0500, 2).status == DONE
    assert bus.control(0xA1, 0x02, 0, 2, 1).received == b"\5"
    assert bus.control(0x21, 0x0B, 0, 2).status == DONE
    assert bus.control(0xA1, 0x03, 0, 2, 1).received == b"\0"


def test_an_answer_is_never_longer_than_what_the_host_has_room_for() -> None:
    bus = Bus()
    assert len(bus.control(0x80, 0x06, 0x0100, length=8).received) == 8
    bus.device.submit(Urb(99, 0x80, 4, struct.pack("<BBHHH", 0x80, 0x06, 0x0100, 0, 18)))
    assert len(bus.done.pop().received) == 4
