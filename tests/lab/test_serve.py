"""Boards of the lab in a process of their own, over TCP, a pseudo-terminal and USB/IP."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from servolink.protocol import Codec, QueryServoListRequest
from servolink.transports import NetworkPlace
from tests import processes
from tests.cli.programs import finished, program
from tests.lab import serve
from tests.lab.usbip.descriptors import BULK_IN, BULK_OUT
from tests.lab.usbip.usbip_host import attached
from tests.sampling import sampled

ROOT = Path(__file__).parents[2]
LINES = ("--tcp", "--pty")
KINDS = ("late", "merging", "halves", "single-bytes", "stalling", "echoing", "boot-text", "no-all", "old-at-opening")


def served(*arguments: str) -> tuple[subprocess.Popen[str], str]:
    """Start the server of the lab; return its program and the first address."""
    process = processes.start((sys.executable, "-W", "error", "-m", "tests.lab.serve", *arguments), cwd=ROOT)
    assert process.stdout is not None
    word, url = process.stdout.readline().split()
    assert word == "listening"
    return process, url


@pytest.mark.parametrize(("kind", "line"), sampled([(kind, line) for kind in KINDS for line in LINES], 2))
def test_an_odd_board_is_used_over_a_real_line(kind: str, line: str) -> None:
    if line == "--pty" and sys.platform == "win32":
        pytest.skip("pseudo-terminals are those of Unix")
    process, url = served(kind, line, *(("127.0.0.1:0",) if line == "--tcp" else ()))
    said = program("--board", url, "servos", "--json", "--timeout", "10")
    assert said.code == 0, said.err
    assert [servo["servo_id"] for servo in said.json["servos"]] == [1, 2, 3, 4]
    ended = finished(process, signal.SIGINT)
    assert (ended.code, ended.err) == (0, "")


def test_an_odd_board_is_served_by_its_kind() -> None:
    _, url = served("big", "--tcp", "127.0.0.1:0")
    said = program("--board", f"{url}?byte_order=big", "servos", "--json")
    assert [servo["servo_id"] for servo in said.json["servos"]] == [1, 2, 3, 4]


def test_a_virtual_board_is_exported_and_nothing_is_served_that_was_not_asked_for() -> None:
    async def main(place: tuple[str, int]) -> None:
        async with attached(*place) as host:
            device = (await host.control(0x80, 0x06, 0x0100, 0, 18)).data
            text = (await host.control(0x80, 0x06, 0x0300 | device[16], 0x0409, 255)).data
            assert text[2:].decode("utf-16-le") == "virtual-5"
            await host.transfer(BULK_OUT, data=Codec().encode(QueryServoListRequest()))
            assert (await host.transfer(BULK_IN, 64)).data[8] == 3  # servos
            process.send_signal(signal.SIGINT)
            assert await host.ended()

    process, url = served("virtual://?servos=3", "--usbip", "127.0.0.1:0", "--seed", "5")
    scheme, _, place = url.partition("://")
    assert scheme == "usbip"
    asyncio.run(main(NetworkPlace.parse(place)))
    ended = finished(process)
    assert (ended.code, ended.out, ended.err) == (0, "", "")


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["even", "--pty"], "must be virtual:// or one of plain, big, old,"),
        (["virtual://?servo=3", "--pty"], "unknown option"),
        (["late"], "give --pty, --tcp or --usbip"),
        (["late", "--pty", "--faults", "rust=1"], "rust"),
    ],
)
def test_wrong_arguments_are_refused(arguments: list[str], error: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        serve.main(arguments)
    assert error in capsys.readouterr().err
