"""A name leads to its board on whatever port, and no address at all to the only board."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest

import servolink
from servolink.discovery import names as resolve
from servolink.discovery import search
from servolink.discovery.names import Alias, alias_for, current_url, load_aliases, resolve_url, save_alias
from servolink.errors import InvalidAddress, OpenError
from servolink.transports.device_info import DeviceInfo, PortIdentity

BOARD = DeviceInfo("serial:///dev/ttyACM0", "board", PortIdentity(serial_number="A1"))
MOVED = DeviceInfo("serial:///dev/ttyACM7", "board", PortIdentity(serial_number="A1"))


@pytest.fixture(autouse=True)
def _own_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


@pytest.fixture(name="here")
def _here(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    def here(*candidates: DeviceInfo) -> None:
        monkeypatch.setattr(resolve, "search", lambda: list(candidates))

    return here


@pytest.mark.parametrize("address", ["virtual://", "/dev/ttyACM0", "COM3", "no address", ""])
def test_an_address_is_left_as_it_is(address: str) -> None:
    assert asyncio.run(resolve_url(address)) == address


def test_a_name_follows_its_board_and_keeps_its_options(here: Callable[..., None]) -> None:
    save_alias("left", alias_for("serial:///dev/ttyACM0?baudrate=9600", [BOARD]))
    here(DeviceInfo("hid://1:2/A1", "board", PortIdentity(serial_number="A1")), MOVED)
    assert asyncio.run(resolve_url("left")) == "serial:///dev/ttyACM7?baudrate=9600"


def test_a_bare_device_path_is_the_same_device(tmp_path: Path) -> None:
    link = tmp_path / "by-id"
    link.symlink_to("/dev/ttyACM0")
    for url in ("/dev/ttyACM0", f"serial://{link}", str(link)):
        assert alias_for(url, [BOARD]).serial_number == "A1"
    assert alias_for("COM3", [DeviceInfo("serial://COM3", "", PortIdentity(serial_number="C3"))]).serial_number == "C3"


@pytest.mark.parametrize("url", ["tcp://pi:9000", "hid://1:2/A1", "serial:///dev/ttyUSB5"])
def test_what_has_no_number_or_needs_none_is_kept_by_its_address(url: str) -> None:
    assert alias_for(url, [BOARD]) == Alias(url)
    assert current_url("x", Alias(url), [BOARD]) == url


def test_a_board_that_is_away_or_not_the_only_one_of_its_number_is_said_so() -> None:
    alias = Alias(BOARD.url, "A1")
    with pytest.raises(OpenError, match="left is the board with serial number A1, which is not here"):
        current_url("left", alias, [])
    with pytest.raises(OpenError, match=r"ttyACM0, serial:///dev/ttyACM7"):
        current_url("left", alias, [BOARD, MOVED])


def test_a_name_is_of_one_port_of_one_device() -> None:
    first, second, moved = (
        DeviceInfo(f"serial:///dev/ttyACM{number}", "board", PortIdentity(0x1209, 1, "A1", interface))
        for number, interface in ((0, 0), (1, 2), (7, 2))
    )
    other = DeviceInfo("serial:///dev/ttyACM2", "adapter", PortIdentity(0x0403, 0x6001, "A1", 2))
    save_alias("left", alias_for(second.url, [first, second, other]))
    assert current_url("left", load_aliases()["left"], [first, moved, other]) == moved.url


def test_an_unknown_name_lists_the_known_ones() -> None:
    save_alias("left", Alias("virtual://"))
    with pytest.raises(InvalidAddress, match=r"known: left\).*servolink use lfet URL"):
        asyncio.run(resolve_url("lfet"))


def test_nothing_at_all_is_the_only_board(here: Callable[..., None]) -> None:
    here(BOARD)
    assert asyncio.run(resolve_url(None)) == BOARD.url
    here(BOARD, DeviceInfo("tcp://127.0.0.1:1"))
    with pytest.raises(OpenError, match="2 boards are here"):
        asyncio.run(resolve_url(None))


def test_programs_connect_to_the_only_board_and_by_name(here: Callable[..., None]) -> None:
    here(DeviceInfo("virtual://?servos=5"))
    save_alias("toy", Alias("virtual://?servos=2"))

    async def count() -> tuple[int, int]:
        async with servolink.connect() as board, servolink.connect("toy") as toy:
            return len(await board.servo_ids()), len(await toy.servo_ids())

    assert asyncio.run(count()) == (5, 2)


def test_discover_is_search_in_a_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "search", lambda: [BOARD])
    assert asyncio.run(servolink.discover()) == [BOARD]
