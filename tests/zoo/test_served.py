"""Odd boards in a process of their own, over TCP and a pseudo-terminal.

Module: servolink.virtual.odd.board.
"""

from __future__ import annotations

import signal
import sys

import pytest

from tests.cli.programs import finished, program, started
from tests.sampling import sampled

LINES = ("--tcp", "--pty")
KINDS = ("late", "merging", "halves", "single-bytes", "stalling", "echoing", "boot-text", "no-all", "old-at-opening")


@pytest.mark.parametrize(("kind", "line"), sampled([(kind, line) for kind in KINDS for line in LINES], 2))
def test_an_odd_board_is_used_over_a_real_line(kind: str, line: str) -> None:
    if line == "--pty" and sys.platform == "win32":
        pytest.skip("pseudo-terminals are those of Unix")
    process = started("virtual", "--odd", kind, line, *(("127.0.0.1:0",) if line == "--tcp" else ()))
    assert process.stdout is not None
    url = process.stdout.readline().split()[1]
    said = program("--board", url, "servos", "--json", "--timeout", "10")
    assert said.code == 0, said.err
    assert [servo["servo_id"] for servo in said.json["servos"]] == [1, 2, 3, 4]
    ended = finished(process, signal.SIGINT)
    assert ended.code == 0
