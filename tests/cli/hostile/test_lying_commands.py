"""Every command that talks to a board, with boards that lie: it ends in time, with an exit code and printable words."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import pytest
from serial.tools import list_ports  # type: ignore[import-untyped]

from servolink.cli.index import below
from servolink.project import save_project
from servolink.support import ExitCode
from tests.cli.terminals import in_pipe
from tests.plugged import plugged
from tests.proofs.hostile.calls import PROJECT
from tests.proofs.hostile.corpus import controls
from tests.proofs.hostile.lies import LIES
from tests.proofs.hostile.test_lying_boards import lying
from tests.sampling import sampled
from tests.virtual_time import run

TALKING = {
    "report": ("report --yes --force --seconds 1 -o {new}.zip",),
    "list": ("list --probe",),
    "doctor": ("doctor lying://board",),
    "info": ("info",),
    "servos": ("servos",),
    "watch": ("watch --seconds 1 --alarm current_raw>1 --on-alarm stop",),
    "record": ("record {file}.mcap --seconds 1 --alarm current_raw>1",),
    "move": ("move 1=10 2=-10 --duration 0.05", "move 1=10 --start"),
    "stop": ("stop",),
    "release": ("release --yes",),
    "run": ("run action 1 --start", "run macro 4"),
    "actions": ("actions", "actions 1"),
    "macros": ("macros", "macros 4"),
    "tables": ("tables", "tables 3"),
    "action": ("action add Wave --pose 1=3", "action delete 1 --yes"),
    "macro": ("macro rename 4 Wave",),
    "table": ("table activate 3",),
    "board": ("board memory", "board battery", "board project-id 5", "board mode 1", "board clear --yes"),
    "servo": ("servo hold 1", "servo trim 1 3"),
    "request": ("request 31000",),
    "export": ("export {new}",),
    "plan": ("plan {file}",),
    "apply": ("apply {file} --yes", "apply {file} --yes --replace --no-backup"),
    "rollback": ("rollback {file} --yes",),
    "project": ("project show lying://board",),
    "trim": ("trim --set 1=+2 --start",),
    "events": ("events --seconds 1",),
    "bench": ("bench --requests 2",),
}
EXEMPT = {
    "demo": "has a virtual board of its own",
    "use": "opens nothing",
    "backups": "reads files",
    "twin": "reads files, or asks a person before each movement",
    "figure": "reads files",
    "decode": "reads files",
    "show": "reads files",
    "convert": "reads files",
    "replay": "reads files",
    "encode": "reads files",
    "completion": "opens nothing",
    "complete": "opens nothing",
    "help": "opens nothing",
    "firmware": "examines a new board as `doctor` does",
    "wireshark": "opens nothing",
    "spy": "goes on until somebody ends it, and sends nothing",
    "virtual": "is a board",
    "share": "goes on until somebody ends it",
    "studio": "goes on until somebody ends it",
    "mcp": "goes on until somebody ends it",
    "foxglove": "goes on until somebody ends it",
    "ros2": "goes on until somebody ends it",
    "fleet": "talks to a broker: tests/fleet/test_faults.py",
    "remote": "is refused without a terminal",
    "teach": "goes on until somebody ends it, and then until the servos are held",
}
_MOST_SECONDS = 900.0
"""Of virtual time: an import reads the board several times."""
_LONGEST = "answers twenty times"
"""Takes seconds of processor time."""
_COVERING = {"answers for another", "pushes events without end"}
"""What reaches lines of commands that nothing else reaches."""
_QUICK = {"list", "doctor", "stop", "events"}
"""What is tried with boards that have much to say, too; the others read no more than `Board` does."""


@pytest.fixture
def seconds(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Let commands run in virtual time; return how long each ran."""
    taken: list[float] = []

    async def timed(main: Coroutine[Any, Any, int]) -> int:
        loop = asyncio.get_running_loop()
        begun = loop.time()
        try:
            return await main
        finally:
            taken.append(loop.time() - begun)

    monkeypatch.setattr(asyncio, "run", lambda main: run(timed(main)))
    return taken


def test_every_command_is_tried() -> None:
    assert {*TALKING, *EXEMPT} == {*below("")}, "a command that nobody lies to: add it to tests/cli/hostile"
    assert not TALKING.keys() & EXEMPT.keys()


@pytest.mark.parametrize(
    "name",
    [
        *sampled((name for name in LIES if name != _LONGEST), 1, _COVERING),
        pytest.param(_LONGEST, marks=pytest.mark.slow),
    ],
)
def test_a_command_ends(name: str, seconds: list[float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    url = plugged(monkeypatch, lambda _: lying(LIES[name]), "lying://board", is_found=True)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(list_ports, "comports", list)  # the search finds no board of this computer
    files = {"file": str(tmp_path / "file"), "new": str(tmp_path / "new")}
    save_project(tmp_path / "file", PROJECT)
    for command, patterns in TALKING.items():
        if LIES[name].long and command not in _QUICK:
            continue
        for pattern in patterns:
            said = in_pipe("--url", url, *(word.format_map(files) for word in pattern.split()))
            assert said.code in (ExitCode.OK, ExitCode.FAILED, ExitCode.NO_BOARD), f"{pattern}: {said}"
            assert not controls(said.out + said.err), pattern
            assert said.code == ExitCode.OK or said.err or command in {"list", "doctor", "plan"}, f"{pattern}: {said}"
    assert max(seconds) < _MOST_SECONDS
