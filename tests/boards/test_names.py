"""Names are kept safely, lead to their board on any port, and no name at all leads to the only board.

Module: servolink.support.platforms.locks.
"""

from __future__ import annotations

import asyncio
import os
import stat
import sys
import threading
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import pytest
from hypothesis import given
from hypothesis import strategies as st

import servolink
from servolink.boards import names
from servolink.boards import searching as search
from servolink.boards.names import Alias, Aliases, _changed, current_url, resolve_url
from servolink.errors import InvalidAddress, OpenError, ServolinkError, TransportUnavailable
from servolink.hub import serve_board
from servolink.support import is_name, lock
from servolink.transports import DeviceInfo, PortIdentity
from servolink.virtual import BOARDS, VirtualBoard
from tests.support.platforms.homeless import lose_home

TEXTS = st.text(st.characters(exclude_categories=["Cs"]))


@pytest.fixture(autouse=True)
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    path = Aliases.path()
    assert path.is_relative_to(tmp_path)
    return path


@pytest.mark.parametrize("text", ["left-arm", "a", "Robot_7", "9", "com", "comet", "com3x", "x" * 64])
def test_a_name_is_letters_digits_and_dashes(text: str) -> None:
    assert is_name(text)


@pytest.mark.parametrize(
    "text", ["", "COM3", "com12", "/dev/x", "a b", "virtual://", "a.b", "-a", "é", "a\n", "x" * 65, "٣"]
)
def test_an_address_is_no_name(text: str) -> None:
    assert not is_name(text)


def test_names_are_kept(path: Path) -> None:
    assert Aliases.load() == {}
    Aliases.save("left", Alias("serial:///dev/ttyACM0?baudrate=9600", "A1"))
    Aliases.save("right", Alias("tcp://pi:9000"))
    Aliases.save("left", Alias("serial:///dev/ttyACM1", "A2"))
    assert Aliases.load() == {"left": Alias("serial:///dev/ttyACM1", "A2"), "right": Alias("tcp://pi:9000")}
    assert {file.name for file in path.parent.iterdir()} == {path.name, "boards.lock"}


def test_names_given_by_two_programs_at_once_are_all_kept(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    waits = threading.Event()

    def lock_slowly(file: BinaryIO, *, wait: bool) -> bool:
        waits.set()
        return lock(file, wait=wait)

    path.parent.mkdir(parents=True, exist_ok=True)
    other = threading.Thread(target=Aliases.save, args=("left", Alias("tcp://pi:9000")))
    with path.with_suffix(".lock").open("ab", buffering=0) as file:
        assert lock(file, wait=True)
        monkeypatch.setattr(names, "lock", lock_slowly)
        other.start()
        assert waits.wait(60)
        path.write_text('[boards.right]\nurl = "tcp://pi:9001"\n', encoding="utf-8")
    other.join()
    assert set(Aliases.load()) == {"left", "right"}


@pytest.mark.skipif(sys.platform == "win32", reason="pipes and permissions of POSIX")
def test_names_are_for_their_owner_and_are_not_waited_for(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = path.parent / "new" / path.name
    monkeypatch.setattr(Aliases, "path", staticmethod(lambda: path))
    before = os.umask(0)
    try:
        Aliases.save("left", Alias("tcp://pi:9000"))
    finally:
        os.umask(before)
    modes = [stat.S_IMODE(each.stat().st_mode) for each in (path.parent, path, path.with_suffix(".lock"))]
    assert modes == [0o700, 0o600, 0o600]
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(
        TransportUnavailable, match=r"boards\.toml cannot be used: is not a regular file; correct or remove the file"
    ):
        Aliases.load()
    path.unlink()
    path.write_bytes(b"#" * (1 << 20) + b"\n")
    with pytest.raises(TransportUnavailable, match=r"boards\.toml cannot be used: is larger than 1 MiB"):
        Aliases.load()


def test_a_user_without_a_home_has_no_names(monkeypatch: pytest.MonkeyPatch) -> None:
    lose_home(monkeypatch)
    assert Aliases.load() == {}
    with pytest.raises(TransportUnavailable, match=r"neither an address nor a name \(none is known\)"):
        asyncio.run(resolve_url("left"))
    with pytest.raises(TransportUnavailable, match=r"names for boards cannot be stored: could not .* set HOME"):
        Aliases.save("left", Alias("tcp://pi:9000"))


def test_what_editors_put_before_a_text_is_no_part_of_it(path: Path) -> None:
    path.parent.mkdir(parents=True)
    path.write_text('[boards.left]\nurl = "tcp://pi:9000"\n', encoding="utf-8-sig")
    assert Aliases.load() == {"left": Alias("tcp://pi:9000")}


@given(TEXTS, TEXTS)
def test_any_text_of_a_device_can_be_kept(url: str, serial_number: str) -> None:
    written = tomllib.loads(_changed("", {"name": Alias(url, serial_number)}))["boards"]["name"]
    assert (written["url"], written.get("serial_number", "")) == (url, serial_number)


def test_what_a_terminal_would_obey_is_escaped_in_the_file(path: Path) -> None:
    Aliases.save("left", Alias("serial:///dev/\x9b2J\u202e", "臂"))
    assert path.read_text(encoding="utf-8").endswith(
        '[boards.left]\nurl = "serial:///dev/\\U0000009b2J\\U0000202e"\nserial_number = "臂"\n'
    )


def test_an_address_that_is_no_text_is_refused(path: Path) -> None:
    Aliases.save("left", Alias("tcp://pi:9000"))
    with pytest.raises(TransportUnavailable, match=r"/dev/\\xff: holds bytes outside UTF-8; write each byte as in %FF"):
        Aliases.save("right", Alias("serial:///dev/\udcff"))
    assert Aliases.load() == {"left": Alias("tcp://pi:9000")}


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"[boards", "at end of document"),
        (b"\xff", "save the file as UTF-8"),
        (b"boards = 3", "$.boards"),
        (b"[boards.a]\nurl = 3", "$.boards"),
        (b"[boards.a]\nport = 'x'", "port"),
        (b"[boards.'a b']\nurl = 'x'", "'a b' cannot be a name"),
        (b"[colours]", "colours"),
        (b"x = " + b"[" * 5000, ""),
        (b"x." * 100_000 + b"y = 1", "1,000 dots or more in line 1"),
    ],
)
def test_a_damaged_file_is_one_clear_error_and_is_left_alone(content: bytes, named: str, path: Path) -> None:
    path.parent.mkdir()
    path.write_bytes(content)
    for use in (Aliases.load, lambda: Aliases.save("b", Alias("virtual://"))):
        with pytest.raises(TransportUnavailable) as refused:
            use()
        assert str(path) in str(refused.value)
        assert named in str(refused.value)
    assert path.read_bytes() == content


def test_a_write_that_fails_leaves_the_file_as_it_was(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Aliases.save("left", Alias("virtual://"))

    def no_space(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", no_space)
    with pytest.raises(ServolinkError, match=r"boards\.toml cannot be written: No space left on device; names need"):
        Aliases.save("right", Alias("virtual://"))
    monkeypatch.undo()
    assert {file.name for file in path.parent.iterdir()} == {path.name, "boards.lock"}


BOARD = DeviceInfo("serial:///dev/ttyACM0", "board", PortIdentity(serial_number="A1"))
MOVED = DeviceInfo("serial:///dev/ttyACM7", "board", PortIdentity(serial_number="A1"))


@pytest.fixture(name="here")
def _here(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    def here(*candidates: DeviceInfo) -> None:
        monkeypatch.setattr(names, "search", lambda: list(candidates))

    return here


@pytest.mark.parametrize("address", ["virtual://", "/dev/ttyACM0", "COM3", "no address", ""])
def test_an_address_is_left_as_it_is(address: str) -> None:
    assert asyncio.run(resolve_url(address)) == address


def test_a_name_follows_its_board_and_keeps_its_options(here: Callable[..., None]) -> None:
    Aliases.save("left", Alias.at("serial:///dev/ttyACM0?baudrate=9600", [BOARD]))
    here(DeviceInfo("hid://1:2/A1", "board", PortIdentity(serial_number="A1")), MOVED)
    assert asyncio.run(resolve_url("left")) == "serial:///dev/ttyACM7?baudrate=9600"


def test_a_bare_device_path_is_the_same_device(tmp_path: Path) -> None:
    link = tmp_path / "by-id"
    link.symlink_to("/dev/ttyACM0")
    for url in ("/dev/ttyACM0", f"serial://{link}", str(link)):
        assert Alias.at(url, [BOARD]).serial_number == "A1"
    assert Alias.at("COM3", [DeviceInfo("serial://COM3", "", PortIdentity(serial_number="C3"))]).serial_number == "C3"


@pytest.mark.parametrize("url", ["tcp://pi:9000", "hid://1:2/A1", "serial:///dev/ttyUSB5"])
def test_what_has_no_number_or_needs_none_is_kept_by_its_address(url: str) -> None:
    assert Alias.at(url, [BOARD]) == Alias(url)
    assert current_url("x", Alias(url), [BOARD]) == url


def test_a_board_that_is_away_or_not_the_only_one_of_its_number_is_said_so() -> None:
    alias = Alias(BOARD.url, "A1")
    with pytest.raises(OpenError, match="left is the board with serial number A1, and was not found"):
        current_url("left", alias, [])
    with pytest.raises(OpenError, match=r"ttyACM0, serial:///dev/ttyACM7"):
        current_url("left", alias, [BOARD, MOVED])


def test_a_name_is_of_one_port_of_one_device() -> None:
    first, second, moved = (
        DeviceInfo(f"serial:///dev/ttyACM{number}", "board", PortIdentity(0x1209, 1, "A1", interface))
        for number, interface in ((0, 0), (1, 2), (7, 2))
    )
    other = DeviceInfo("serial:///dev/ttyACM2", "adapter", PortIdentity(0x0403, 0x6001, "A1", 2))
    Aliases.save("left", Alias.at(second.url, [first, second, other]))
    assert current_url("left", Aliases.load()["left"], [first, moved, other]) == moved.url


def test_an_unknown_name_lists_the_known_ones() -> None:
    Aliases.save("left", Alias("virtual://"))
    with pytest.raises(InvalidAddress, match=r"known: left\).*servolink use lfet BOARD"):
        asyncio.run(resolve_url("lfet"))


def test_blanks_around_a_name_are_no_part_of_it() -> None:
    Aliases.save("left", Alias("virtual://"))
    assert asyncio.run(resolve_url(" left\n")) == "virtual://"


def test_nothing_at_all_is_the_only_board(here: Callable[..., None]) -> None:
    here(BOARD)
    assert asyncio.run(resolve_url(None)) == BOARD.url
    here(BOARD, DeviceInfo("tcp://127.0.0.1:1"))
    with pytest.raises(OpenError, match="2 boards are here"):
        asyncio.run(resolve_url(None))


def test_the_hub_of_the_only_board_has_its_name(here: Callable[..., None], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(BOARDS, "here", VirtualBoard(2))
    monkeypatch.setattr("servolink.boards.hubs.is_new_board", lambda url: False)
    here(DeviceInfo("virtual://here"))

    async def name() -> str:
        async with serve_board() as (hub, _):
            return hub.name

    assert asyncio.run(name()) == "here"
    Aliases.save("left", Alias("virtual://here"))
    assert asyncio.run(name()) == "left"
    Aliases.save("arm", Alias("virtual://here"))
    assert names.Aliases.name_at("virtual://here") is None, "two names"


def test_a_board_with_a_number_is_known_by_it_on_any_port(here: Callable[..., None]) -> None:
    Aliases.save("left", Alias.at(BOARD.url, [BOARD]))
    here(MOVED, DeviceInfo("serial:///dev/ttyACM0"))
    assert names.Aliases.name_at(MOVED.url) == "left"
    assert names.Aliases.name_at("serial:///dev/ttyACM0") is None


def test_programs_connect_to_the_only_board_and_by_name(here: Callable[..., None]) -> None:
    here(DeviceInfo("virtual://?servos=5"))
    Aliases.save("toy", Alias("virtual://?servos=2"))

    async def count() -> tuple[int, int]:
        async with servolink.connect() as board, servolink.connect("toy") as toy:
            return len(await board.servo_ids()), len(await toy.servo_ids())

    assert asyncio.run(count()) == (5, 2)


def test_discover_is_search_in_a_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "search", lambda: [BOARD])
    assert asyncio.run(servolink.discover()) == [BOARD]
