"""What belongs to one board is one board, and the only one is taken."""

from __future__ import annotations

import pytest

from servolink.discovery.search import boards, only
from servolink.errors import OpenError
from servolink.transports.device_info import DeviceInfo, PortIdentity

SERIAL = DeviceInfo("serial:///dev/ttyACM0", "board", PortIdentity(serial_number="A1"))
HID = DeviceInfo("hid://1234:5678/A1", "board", PortIdentity(serial_number="A1"))
USB = DeviceInfo("usb://1234:5678/A1", "board", PortIdentity(serial_number="A1"), "no permission")
OTHER = DeviceInfo("serial:///dev/ttyUSB0", "adapter")


def forbidden(candidate: DeviceInfo) -> DeviceInfo:
    return DeviceInfo(candidate.url, candidate.product, candidate.identity, "no permission")


@pytest.mark.parametrize(
    ("candidates", "found"),
    [
        ([], []),
        ([SERIAL, HID, USB], [SERIAL]),
        ([forbidden(SERIAL), HID], [HID]),
        ([forbidden(SERIAL), USB], [forbidden(SERIAL)]),
        ([SERIAL, OTHER], [SERIAL, OTHER]),
        (
            [OTHER, DeviceInfo("serial:///dev/ttyUSB1", "adapter")],
            [OTHER, DeviceInfo("serial:///dev/ttyUSB1", "adapter")],
        ),
    ],
)
def test_a_board_is_reached_in_several_ways(candidates: list[DeviceInfo], found: list[DeviceInfo]) -> None:
    assert boards(candidates) == found


def test_a_number_that_two_ports_have_tells_nothing() -> None:
    twin = DeviceInfo("serial:///dev/ttyACM1", "board", PortIdentity(serial_number="A1"))
    assert boards([SERIAL, twin]) == [SERIAL, twin]


def test_the_only_board_is_taken() -> None:
    assert only([SERIAL, HID]) == SERIAL.url
    assert only([SERIAL, forbidden(OTHER)]) == SERIAL.url


@pytest.mark.parametrize(
    ("candidates", "named"),
    [([], ["servolink doctor"]), ([USB], [USB.url, "no permission"]), ([SERIAL, OTHER], [SERIAL.url, OTHER.url])],
)
def test_otherwise_it_says_what_is_here(candidates: list[DeviceInfo], named: list[str]) -> None:
    with pytest.raises(OpenError) as refused:
        only(candidates)
    assert all(text in str(refused.value) for text in named)


def test_what_a_device_calls_itself_is_made_safe() -> None:
    with pytest.raises(OpenError, match=r"hid://1:2/\\x1b\[2J"):
        only([SERIAL, DeviceInfo("hid://1:2/\x1b[2J", identity=PortIdentity(serial_number="\x1b[2J"))])
