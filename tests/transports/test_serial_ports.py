"""Serial ports on USB are found without being opened, and a board is followed to another one.

Modules: servolink.transports.device_info, servolink.transports.serial_ports.
"""

from __future__ import annotations

import os

import pytest
from serial.tools import list_ports  # type: ignore[import-untyped]

from servolink.transports import DeviceInfo, PortIdentity, PortTracker, serial_ports
from tests.transports.listed_ports import listed, port
from tests.virtual_time import run


def followed(url: str, monkeypatch: pytest.MonkeyPatch, *looks: list[object]) -> list[str]:
    """Return where the board that was at `url` at the first look is at each further one."""

    async def follow() -> list[str]:
        tracker = PortTracker(url)
        listed(monkeypatch, *looks[0])
        await tracker.learn()
        urls: list[str] = []
        for look in looks[1:]:
            listed(monkeypatch, *look)
            urls.append(await tracker.url())
        return urls

    return run(follow())


def test_serial_ports_on_usb_can_be_boards(monkeypatch: pytest.MonkeyPatch) -> None:
    listed(monkeypatch, port("COM4", 1, "board", "A1"), port("COM1"), port("COM%3", 1))
    assert serial_ports.candidates() == [
        DeviceInfo("serial://COM4", "board", PortIdentity(1, None, "A1")),
        DeviceInfo("serial://COM%253", identity=PortIdentity(1)),
    ]


def test_a_port_with_the_names_of_two_drivers_is_one_board(monkeypatch: pytest.MonkeyPatch) -> None:
    """On macOS; the second port of a board has another end of its name."""
    names = ("cu.usbmodem5AF71", "cu.usbmodem5AF73", "cu.wchusbserial5AF71")
    listed(monkeypatch, *(port(f"/dev/{name}", 1, "board", "5AF7", location="20-1") for name in names))
    urls = [device.url for device in serial_ports.candidates()]
    assert urls == ["serial:///dev/cu.usbmodem5AF71", "serial:///dev/cu.usbmodem5AF73"]
    listed(monkeypatch, *(port(f"/dev/{names[at]}", 1, "board", "5AF7", location=f"20-{at}") for at in (0, 2)))
    assert len(serial_ports.candidates()) == 2


def test_a_board_is_followed_to_another_port_with_its_options(monkeypatch: pytest.MonkeyPatch) -> None:
    url = "serial://COM4?baudrate=9600"
    here, moved, other = (
        port(name, 1, "board", number) for name, number in (("COM4", "A"), ("COM 7", "A"), ("COM5", "B"))
    )
    assert followed(url, monkeypatch, [here], [moved, other], [other], [moved, here], [here]) == [
        "serial://COM%207?baudrate=9600",
        url,  # it is not here
        url,  # two cannot be told apart
        url,
    ]


def test_each_port_of_a_board_with_several_is_followed_wherever_it_is_plugged_in(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = [port(f"COM{4 + number}", 1, "board", "A", location=f"1-1:1.{number}") for number in range(2)]
    after = [port(f"COM{9 - number}", 1, "board", "A", location=f"1-4.2:1.{number}") for number in range(2)]
    assert followed("COM5", monkeypatch, before, after) == ["serial://COM8"]


@pytest.mark.parametrize("url", ["COM4", "tcp://COM4:1", "no address", "serial://COM9"])
def test_only_a_port_with_a_serial_number_is_followed(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert followed(url, monkeypatch, [port("COM4", 1)], [port("COM7", 1)]) == [url]


def test_a_device_that_vanishes_while_ports_are_listed_hides_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    looks: list[Exception | None] = [TypeError("int() can't convert non-string with explicit base"), None]

    def comports() -> list[object]:
        if error := looks.pop(0):
            raise error
        return [port("COM4", 1)]

    monkeypatch.setattr(list_ports, "comports", comports)
    assert serial_ports.candidates() == [DeviceInfo("serial://COM4", identity=PortIdentity(1))]
    looks[:] = [OSError()] * 3
    assert serial_ports.list_ports() == []


def test_a_port_that_may_not_be_opened_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    listed(monkeypatch, port(os.devnull, 1))
    assert serial_ports.candidates()[0].problem == ""
    monkeypatch.setattr(serial_ports, "is_accessible", lambda path: False)
    assert "servolink doctor" in serial_ports.candidates()[0].problem
