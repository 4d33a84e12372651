"""Virtual boards: one in a process of its own, for the tests of a module, and one in this process, in virtual time."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Iterator
from typing import NamedTuple

import pytest

from servolink import virtual
from servolink.cli import command_session
from tests.cli.programs import finished, started
from tests.cli.robot import Robot


class Addresses(NamedTuple):
    """Where the board is; the terminal takes one host at a time."""

    terminal: str
    network: str


@pytest.fixture(scope="module")
def served() -> Iterator[Addresses]:
    """Serve a board with 16 servos over a pseudo-terminal and TCP."""
    if sys.platform == "win32":
        pytest.skip("pseudo-terminals are those of Unix")
    process = started("virtual", "--pty", "--tcp", "127.0.0.1:0", "--seed", "1")
    try:
        assert process.stdout is not None
        addresses = [process.stdout.readline().split()[1] for _ in range(2)]
        yield Addresses(*addresses)
    finally:
        said = finished(process, signal.SIGINT)
    assert (said.code, said.err) == (0, "ended: what the board stores is gone\n")


@pytest.fixture(autouse=True)
def _no_board_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("SERVOLINK_BOARD", "SERVOLINK_URL"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def robot(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Robot:
    """Put a board with 3 servos behind `virtual://`, in virtual time."""
    robot = Robot(capsys)
    monkeypatch.setattr(asyncio, "run", robot.clock.run)
    monkeypatch.setattr(virtual, "from_address", robot.line)
    monkeypatch.setattr(command_session, "_PATIENCE", 1e9)  # until Ctrl-C ends the process, which is this one
    return robot
