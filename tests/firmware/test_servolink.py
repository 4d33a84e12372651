"""servolink with the firmware: in virtual time, and as a process with sanitizers that is killed."""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

import servolink
from servolink.client import Board, connect
from servolink.firmware.compiling import IMAGE
from tests import processes
from tests.cli.terminals import in_pipe
from tests.firmware.emulated import emulated, needs_emulator
from tests.firmware.fuzz import fuzz
from tests.firmware.host import (
    FIRMWARE,
    HARDWARE,
    HostBoard,
    HostTransport,
    compile_once,
    needs_compiler,
)
from tests.project.pulled import OLD

pytestmark = needs_compiler

Serve = Callable[[str], tuple[subprocess.Popen[str], str]]
"""Start of the program with one kind of line; returns the process and the address."""
DEMO = Path(servolink.__file__).parent / "studio/demo.servolink.json"


async def _movements(board: Board, width: Callable[[int], float], within: float) -> None:
    """Move, import and run a macro; `width` is that of the last pulse of a servo, in microseconds."""
    await board.set_servo(255, start=True, hold=True)
    await board.move({1: 30, 2: -45}, duration=1.0, wait=True)
    await asyncio.sleep(0.1)  # an angle is rounded to degrees
    assert [width(0), width(1)] == pytest.approx([1500 + 30 / 0.09, 1000], abs=within)
    await board.apply_project(OLD, backup=False)
    await board.run_macro(1, wait=True)
    await asyncio.sleep(0.1)
    assert width(0) == pytest.approx(1500 - 3 / 0.09, abs=within), "action 2 goes to 0, corrected by -3"
    await board.stop()
    assert [servo.is_start for servo in await board.servos()] == [False] * 16


async def test_the_client_moves_the_firmware(board: HostBoard) -> None:
    async with connect(HostTransport(board)) as connected:
        await _movements(connected, lambda servo: board.pulses[servo], 0.1)


@needs_emulator
@pytest.mark.parametrize("line", ["uart", "usb"])
async def test_the_client_moves_the_emulated_pico(line: str) -> None:
    with emulated(IMAGE, line) as pico:
        async with connect(HostTransport(pico)) as connected:
            await _movements(connected, lambda servo: pico.pulses[servo][-1][1], 0.5)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compile_once(tmp_path_factory, "board", [HARDWARE, FIRMWARE / "host/main.c"], "-fsanitize=address")


@pytest.fixture
def serve(program: Path, tmp_path: Path) -> Serve:
    def started(kind: str) -> tuple[subprocess.Popen[str], str]:
        process = processes.start([str(program), kind, str(tmp_path / "flash")])
        assert process.stdout is not None
        place = process.stdout.readline().strip()
        return process, place if kind == "tcp" else f"serial://{place}"

    return started


@pytest.mark.parametrize("kind", ["tcp", pytest.param("pty", marks=pytest.mark.slow)])
def test_a_project_outlives_a_killed_process(
    serve: Serve,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
) -> None:
    def command(*words: str) -> str:
        said = in_pipe(*words)
        assert (said.code, said.err) == (0, "")
        return said.out

    def on_board(*words: str) -> str:
        return command("--url", url, *words)

    monkeypatch.chdir(tmp_path)
    process, url = serve(kind)
    assert "verified" in on_board("apply", str(DEMO), "--yes")
    process.kill()
    processes.finish(process)
    process, url = serve(kind)
    assert "0 differences" in on_board("plan", str(DEMO))
    on_board("servo", "start", "all")
    moved = json.loads(on_board("move", "1=30", "--duration", "1", "--wait", "--json"))
    assert moved, "the servo arrived"
    assert "nothing is wrong" in command("doctor", url)
    process.terminate()
    _, errors = processes.finish(process)
    assert not errors, "the sanitizers found something"


@pytest.mark.skipif(shutil.which("clang") is None, reason="needs clang with libFuzzer, of the Debian package clang")
@pytest.mark.parametrize(
    "limit",
    [
        pytest.param("-runs=3000", id="some"),
        pytest.param("-max_total_time=60", id="minute", marks=pytest.mark.slow),
    ],
)
def test_any_bytes_are_survived(tmp_path: Path, limit: str) -> None:
    assert "Done " in fuzz(tmp_path, limit)
