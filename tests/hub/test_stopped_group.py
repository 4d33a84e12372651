"""A hub, a recorder and a program that are stopped together for a while, as when a computer is frozen."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from pathlib import Path

import pytest

from servolink.client import connect
from servolink.hub.engine.hub_gates import SETTLING
from servolink.recorder import Recording
from tests import processes

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs signals of Unix")

_PROGRAM = """
import sys
from servolink.__main__ import main
from servolink.hub.engine import hub_gates
hub_gates.LONGEST_GAP = {gap}
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize(
    ("gap", "seconds"), [(2.0, 3.0), pytest.param(5.0, 60.0, marks=pytest.mark.slow)], ids=["briefly", "a minute"]
)
def test_programs_that_were_stopped_move_nothing_late(
    gap: float, seconds: float, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "out.mcap"
    servolink = (sys.executable, "-c", _PROGRAM.format(gap=gap))
    hub = processes.start((*servolink, "share", "--board", "virtual://?servos=2", "--name", "frozen", "--json"))
    assert hub.stdout is not None
    hub.stdout.readline()
    recorder = processes.start((*servolink, "record", str(path), "--board", "share://frozen", "--hz", "20"))
    processes.until(lambda: path.exists() and path.stat().st_size > 1000)

    async def main() -> None:
        async with connect("share://frozen") as board:
            await board.move({1: 20}, duration=0.01, wait=True)
            for program in (hub, recorder):
                os.kill(program.pid, signal.SIGSTOP)
            waiting = [asyncio.create_task(board.move({1: 70 + each}, duration=0.01)) for each in range(5)]
            await asyncio.sleep(seconds)
            for program in (hub, recorder):
                os.kill(program.pid, signal.SIGCONT)
            await asyncio.gather(*waiting, return_exceptions=True)
            assert (await board.servos())[0].angle == 20
            assert "the hub stood still for" in caplog.text
            await asyncio.sleep(2 * SETTLING)
            await board.move({1: 40}, duration=0.01, wait=True)
            assert (await board.servos())[0].angle == 40

    asyncio.run(main())
    processes.finish(recorder, signal.SIGINT)
    processes.finish(hub, signal.SIGINT)
    recording = Recording(path)
    times = [entry.time for entry in recording.entries()]
    assert times == sorted(times)
    assert recording.remarks == []
