"""`servolink studio`: which arguments it takes."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from tests.cli.programs import call, finished, started

pytest.importorskip("aiohttp", reason="the extra studio is not installed")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--host", "foo"), "must be an IP address of this machine, or * for all of them, not 'foo'"),
        (("--host", ""), "must be an IP address"),
        (("--host", "192.168.1.20"), "--host 192.168.1.20 opens the studio to the network"),
        (("--host", "*"), "--host * opens the studio to the network"),
        (("--allow-host", "http://robot"), "must be a name or address"),
        (("--demo", "--board", "rex"), "--demo uses a board of its own; leave out --board"),
    ],
)
def test_what_cannot_be_is_wrong_usage(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], words: str
) -> None:
    said = call(capsys, "studio", "--no-browser", *arguments)
    assert said.code == 2
    assert words in said.err


def test_the_demo_leaves_the_board_of_other_commands_alone(tmp_path: Path) -> None:
    runtime = tmp_path / "runtime"
    runtime.mkdir(mode=0o700)
    folders = {"XDG_RUNTIME_DIR": str(runtime), "XDG_DATA_HOME": str(tmp_path / "data")}
    studio = started("studio", "--demo", "--no-browser", SERVOLINK_BOARD="nonsense://x", **folders)
    assert studio.stdout is not None
    assert studio.stdout.readline().startswith("studio http://127.0.0.1:"), finished(studio)
    assert finished(studio, signal.SIGTERM).code == 0


def test_a_studio_behind_a_proxy_that_speaks_tls_warns_of_nothing(tmp_path: Path) -> None:
    studio = started(
        "studio", "--demo", "--no-browser", "--allow-host", "https://robot.example", XDG_DATA_HOME=str(tmp_path)
    )
    assert studio.stdout is not None
    addresses = [studio.stdout.readline() for _ in ("studio", "drive", "watch")]
    assert addresses[1].startswith("drive https://robot.example/#token="), finished(studio)
    assert "not encrypted" not in finished(studio, signal.SIGTERM).err
