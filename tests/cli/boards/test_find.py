"""`servolink list` and `servolink use`, and other commands without an address.

Modules: servolink.cli.boards.find, servolink.cli.boards.known.
"""

from __future__ import annotations

import asyncio
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from servolink.boards import Aliases, BoardProfile, ProfileFile, SafetyLimits
from servolink.cli.boards import find as boards
from servolink.connection import Connection
from servolink.transports import DeviceInfo, PortIdentity
from tests.cli.programs import call, finished, started
from tests.cli.terminals import in_pipe, in_terminal

BOARD = DeviceInfo("virtual://?servos=3", "toy board", PortIdentity(serial_number="A1"))
CLOSED = DeviceInfo(
    "hid://1234:5678/B2", "other \x1b[31mboard", PortIdentity(serial_number="B2"), "no permission for /dev/hidraw0"
)
PORT = DeviceInfo("serial:///dev/ttyACM7", "board", PortIdentity(serial_number="C3"))


@pytest.fixture(autouse=True)
def _own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("SERVOLINK_BOARD", "SERVOLINK_URL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@pytest.fixture(name="here")
def _here(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Return what makes these the only devices found."""

    def here(*candidates: DeviceInfo) -> None:
        async def discover() -> list[DeviceInfo]:
            return list(candidates)

        for module in ("servolink.cli.boards.find", "servolink.cli.command_session"):
            monkeypatch.setattr(f"{module}.search", lambda: list(candidates))
        monkeypatch.setattr(boards, "discover", discover)

    return here


@pytest.fixture(name="two_served")
def _two_served() -> Iterator[list[str]]:
    """Serve two boards, with 2 and 3 servos."""
    servers = [started("virtual", "--tcp", "127.0.0.1:0", "--servos", servos) for servos in ("2", "3")]
    try:
        yield [server.stdout.readline().split()[1] for server in servers if server.stdout]
    finally:
        for server in servers:
            server.terminate()
            finished(server)


def test_list_shows_what_is_here_and_what_is_in_the_way(
    here: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    here(BOARD, CLOSED)
    said = call(capsys, "list")
    assert said.code == 0
    _, first, second = said.out.splitlines()
    assert first.split("  ")[0] == BOARD.url
    assert "no permission for /dev/hidraw0" in second
    assert "\x1b" not in said.out


def test_list_leaves_out_empty_columns(here: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    here(DeviceInfo("serial:///dev/ttyACM0", "USB Serial"), DeviceInfo("tcp://127.0.0.1:7878", "virtual board"))
    assert call(capsys, "list").out.splitlines()[0].split() == ["address", "product"]
    here(PORT)
    assert call(capsys, "list").out.splitlines()[0].split() == ["address", "product", "serial", "number"]


def test_list_without_a_board_is_3(here: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    here()
    said = call(capsys, "list")
    assert (said.code, said.out) == (3, "")
    assert "servolink doctor" in said.err
    said = call(capsys, "list", "--json")
    assert (said.code, said.json) == (3, {"boards": []})


def test_list_names_boards(here: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    here(BOARD, PORT, DeviceInfo("serial:///dev/ttyACM9", "board", PortIdentity(serial_number="D4")))
    assert call(capsys, "use", "left", "serial:///dev/ttyACM7").code == 0
    assert call(capsys, "use", "gone", "serial:///dev/ttyACM9").code == 0
    here(BOARD, DeviceInfo("serial:///dev/ttyACM8", "board", PortIdentity(serial_number="C3")))
    boards = call(capsys, "list", "--json").json["boards"]
    assert [(board["url"], board["name"]) for board in boards] == [(BOARD.url, None), ("serial:///dev/ttyACM8", "left")]


def test_list_shows_boards_although_their_names_are_broken(
    here: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    here(BOARD)
    path = Aliases.path()
    path.parent.mkdir(parents=True)
    path.write_text("[boards", encoding="utf-8")
    said = call(capsys, "list")
    assert (said.code, BOARD.url in said.out) == (0, True)
    assert re.fullmatch(r"servolink: \S+boards\.toml cannot be used: .*; correct or remove the file\n", said.err)
    assert call(capsys, "list", "--json").json["boards"][0]["name"] is None


def test_list_asks_each_only_with_probe(here: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    here(BOARD, DeviceInfo("serial:///dev/nowhere"))
    assert "response" not in call(capsys, "list", "--json").json["boards"][0]
    answered, absent = call(capsys, "list", "--probe", "--json").json["boards"]
    assert answered["response"]["byte_order"] == "little"
    assert (absent["response"], "there is no /dev/nowhere" in absent["problem"]) == (None, True)
    assert "little endian, project none" in call(capsys, "list", "--probe").out


def test_use_says_what_the_name_stands_for(here: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    here(PORT)
    assert "serial number C3, on any port" in call(capsys, "use", "left", "/dev/ttyACM7").out
    said = call(capsys, "use", "toy", "virtual://?servos=3", "--json")
    assert said.json == {"name": "toy", "url": "virtual://?servos=3", "serial_number": ""}
    assert call(capsys, "--url", "toy", "info", "--json").json["servos"] == 3


def test_a_name_keeps_the_options_of_the_address(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert call(capsys, "use", "toy", "virtual://?servos=3&byte_order=big&patience=0.2").code == 0
    assert call(capsys, "--url", "toy", "info", "--json").json["servos"] == 3
    waited = list[float]()
    shake_hands = Connection.shake_hands

    async def noting(connection: Connection) -> None:
        waited.append(connection.patience)
        await shake_hands(connection)

    monkeypatch.setattr(Connection, "shake_hands", noting)
    assert call(capsys, "--url", "toy", "--byte-order", "little", "info").code == 3
    assert waited == [0.2]
    assert call(capsys, "--timeout", "5", "use", "arm", "virtual://?depth=2", "--byte-order", "big").code == 0
    assert Aliases.load()["arm"].url == "virtual://?depth=2&byte_order=big&patience=5"
    said = call(capsys, "use", "toy", "virtual://?servos=3&byte_order=middle")
    assert (said.code, "option byte_order must be one of little, big, not 'middle'" in said.err) == (2, True)


def test_a_name_is_given_to_another_board_only_if_somebody_says_so(
    here: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    here()
    assert call(capsys, "use", "arm", "virtual://").code == 0
    assert call(capsys, "use", "arm", "virtual://").code == 0
    said = call(capsys, "use", "arm", "tcp://10.0.0.1:9")
    assert (said.code, said.out) == (2, "")
    assert said.err.endswith("error: arm is virtual:// now; --yes gives the name to tcp://10.0.0.1:9\n")
    assert Aliases.load()["arm"].url == "virtual://"
    ProfileFile("arm").save(BoardProfile(limits=SafetyLimits(speed_cap=30)))
    said = call(capsys, "use", "arm", "tcp://10.0.0.1:9", "--json")
    assert "which would lose its limits to tcp://10.0.0.1:9: see `servolink board show arm`; --yes" in said.err
    assert call(capsys, "use", "arm", "tcp://10.0.0.1:9", "--yes").code == 0
    assert Aliases.load()["arm"].url == "tcp://10.0.0.1:9"


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
@pytest.mark.parametrize(("answer", "url"), [("n", "virtual://"), ("y", "tcp://10.0.0.1:9")])
def test_somebody_at_a_terminal_is_asked_for_a_name_that_is_taken(
    answer: str, url: str, here: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    here()
    assert call(capsys, "use", "arm", "virtual://").code == 0
    said = in_terminal("use", "arm", "tcp://10.0.0.1:9", typed=f"{answer}\n")
    assert "Give the name to tcp://10.0.0.1:9?" in said.out
    assert Aliases.load()["arm"].url == url


def test_use_lists_and_forgets_names(here: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    here(PORT)
    assert call(capsys, "use", "--list").out == "no board has a name; `servolink use NAME BOARD` gives one\n"
    for name, address in (("toy", "virtual://"), ("left", "serial:///dev/ttyACM7")):
        assert call(capsys, "use", name, address).code == 0
    assert [line.split() for line in call(capsys, "use", "--list").out.splitlines()[1:]] == [
        ["left", "serial:///dev/ttyACM7", "C3"],
        ["toy", "virtual://"],
    ]
    assert call(capsys, "use", "--remove", "toy").out == "toy is forgotten\n"
    assert [one["name"] for one in call(capsys, "use", "--list", "--json").json["names"]] == ["left"]
    said = call(capsys, "use", "--remove", "toy")
    assert (said.code, said.err) == (1, "servolink: no board is named 'toy' (names: left); nothing was changed\n")
    assert call(capsys, "use", "--list", "x", "virtual://").code == 2
    assert call(capsys, "use", "x").code == 2


@pytest.mark.parametrize(
    ("arguments", "code"), [(("COM3", "virtual://"), 2), (("a b", "virtual://"), 2), (("toy", "no address"), 2)]
)
def test_use_refuses_what_would_not_be_found_again(
    arguments: tuple[str, str], code: int, here: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    here()
    said = call(capsys, "use", *arguments)
    assert (said.code, said.out) == (code, "")
    assert not list(Path().glob("boards.toml"))


def test_a_command_takes_the_only_board(here: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    here(BOARD, CLOSED)
    assert call(capsys, "info", "--json").json["servos"] == 3


def test_the_only_board_may_be_closed(here: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    here(CLOSED)
    said = call(capsys, "info")
    assert (said.code, said.out) == (3, "")
    assert "no permission for /dev/hidraw0" in said.err


def test_several_boards_are_wrong_usage_for_a_program(two_served: list[str]) -> None:
    for command in ("info", "share", "record x.mcap"):  # the studio offers them on its page
        said = in_pipe(*command.split())
        assert (said.code, said.out) == (2, ""), command
        assert all(url in said.err for url in two_served), command


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
def test_somebody_at_a_terminal_is_asked(two_served: list[str]) -> None:
    said = in_terminal("servos", typed="2\n")
    assert said.code == 0
    assert all(url in said.out for url in two_served)
    assert "Which one?" in said.out
    assert in_terminal("servos", typed="3\n").code == 2


def test_served_boards_are_found_and_asked(two_served: list[str]) -> None:
    boards = in_pipe("list", "--probe", "--json").json["boards"]
    served = {board["url"]: board["response"]["project_id"] for board in boards if board["url"] in two_served}
    assert served == dict.fromkeys(two_served, 0)
    assert asyncio.run(_discovered()) >= set(two_served)


def test_a_served_board_is_found_with_its_byte_order() -> None:
    server = started("virtual", "--tcp", "127.0.0.1:0", "--servos", "2", "--byte-order", "big")
    try:
        assert server.stdout
        url = server.stdout.readline().split()[1]
        assert f"{url}?byte_order=big" in asyncio.run(_discovered())
        assert in_pipe("--url", f"{url}?byte_order=big", "info", "--json").json["servos"] == 2
    finally:
        server.terminate()
        finished(server)


async def _discovered() -> set[str]:
    import servolink

    return {candidate.url for candidate in await servolink.discover()}


@pytest.mark.parametrize("address", ["nonsense://x", "virtual://?servos=many"])
def test_a_wrong_address_gets_no_name(address: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "use", "arm", address)
    assert (said.code, said.out) == (2, "")
    assert said.err.startswith(f"servolink: {address}: ")
    assert call(capsys, "use", "--list", "--json").json == {"names": []}
