"""A virtual board in a process of its own, for the tests of a module."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from typing import NamedTuple

import pytest

from tests.cli.programs import finished, started


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
    assert (said.code, said.err) == (0, "")


@pytest.fixture(autouse=True)
def _no_board_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SERVOLINK_URL", raising=False)
