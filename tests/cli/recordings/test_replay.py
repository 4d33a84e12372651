"""`servolink replay`: the recorded board for other programs, and its commands on a virtual robot."""

from __future__ import annotations

import asyncio
import signal
from pathlib import Path

import pytest

from servolink.client import connect
from servolink.protocol import ExecuteActionRequest, ExecuteMacroRequest, Step
from servolink.recorder import RecordedServo, ServosRead
from servolink.virtual import VirtualBoard, save_state
from tests.cli.programs import call, finished, started
from tests.cli.terminals import in_terminal
from tests.recorder.files import write
from tests.recorder.test_replaying import WAVE, passed, wave
from tests.virtual_time import run


@pytest.fixture
def _in_virtual_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(asyncio, "run", run)


@pytest.mark.usefixtures("_in_virtual_time")
def test_commands_move_a_virtual_robot(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "replay", str(WAVE), "--to", "virtual")
    assert said.code == 0
    assert "     0.002  ExecuteAction 1=60 in" in said.out
    assert "    1   30.0\n    2  -30.0\n" in said.out
    assert said.out.endswith("played 7 commands of 1.1 s\n")


@pytest.mark.usefixtures("_in_virtual_time")
def test_terminal_shows_the_robot_as_it_moves() -> None:
    said = in_terminal("replay", str(WAVE), "--to", "virtual")
    assert said.code == 0
    assert "7 commands of 7" in said.out
    assert "at 1 times the speed" in said.out
    assert "released" in said.out


@pytest.mark.usefixtures("_in_virtual_time")
@pytest.mark.parametrize("speed", ["0.5", "100"])
def test_speed_changes_nothing_but_the_time(speed: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "replay", str(WAVE), "--to", "virtual", "--speed", speed, "--json")
    assert said.json == {"played": 7, "seconds": pytest.approx(1.12, abs=0.1), "angles": {"1": 30.0, "2": -30.0}}


@pytest.mark.usefixtures("_in_virtual_time")
def test_robot_begins_as_it_stood_and_moves_to_the_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    state = RecordedServo(2, 80.0, "degree", 5, 300, 1, is_start=True, is_hold=True)
    move = ExecuteActionRequest((Step(3, 90, 1000),))
    path = write(tmp_path / "x.mcap", [(0.0, ServosRead((state,))), *passed((0.5, ">", move))])
    said = call(capsys, "replay", str(path), "--to", "virtual", "--json").json
    assert (said["angles"]["2"], said["angles"]["3"]) == (80.0, 90.0)
    assert said["seconds"] == pytest.approx(10.5, abs=0.2)


@pytest.mark.usefixtures("_in_virtual_time")
def test_what_the_virtual_board_does_not_store_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(write(tmp_path / "x.mcap", passed((0.0, ">", ExecuteMacroRequest(3)))))
    assert "1 command ran what was stored on the recorded board" in call(capsys, "replay", path, "--to", "virtual").err
    save_state(VirtualBoard(16), tmp_path / "board.state")
    assert call(capsys, "replay", path, "--to", "virtual", "--state", str(tmp_path / "board.state")).code == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--to", "/dev/ttyUSB0"), "a recording is never played on one"),
        (("--to", "tcp://robot:9000"), "a recording is never played on one"),
        (("--to", "virtual://?servos=3"), "without options"),
        (("--to", "virtual", "--tcp", "127.0.0.1:0"), "closed to other programs"),
        (("--state", "x"), "--state needs --to virtual"),
        (("--speed", "0"), "must be from 0.01"),
    ],
)
def test_wrong_options(options: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "replay", str(WAVE), *options)
    assert said.code == 2
    assert message in " ".join(said.err.split())


@pytest.mark.slow
def test_program_finds_the_recorded_board() -> None:
    process = started("replay", str(WAVE), "--tcp", "127.0.0.1:0", "--speed", "10")
    assert process.stdout is not None
    url = process.stdout.readline().split()[1]

    async def main() -> None:
        async with connect(url) as board:
            await wave(board)

    try:
        asyncio.run(main())
    finally:
        said = finished(process, signal.SIGINT)
    assert said.code == 0
