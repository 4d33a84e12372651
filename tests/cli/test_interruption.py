"""Ctrl-C: at once, without a traceback, and with the truth about the servos.

Modules: servolink.cli.command_session, servolink.support.platforms.signals.
"""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path

import pytest

from servolink.project import build_project, save_project
from servolink.protocol import Action
from servolink.support import Signals
from servolink.transports import Faults
from tests import processes
from tests.cli.conftest import Addresses
from tests.cli.programs import environment, finished, in_terminal, patient
from tests.cli.robot import Robot
from tests.sampling import sampled

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals are those of Unix")


def test_a_move_is_finished_by_the_servos(robot: Robot) -> None:
    robot.at(1.0, lambda: signal.raise_signal(signal.SIGINT))
    said = robot("move", "1=90", "--duration", "60", "--start")
    assert (said.code, said.out) == (130, "")
    assert said.err == "interrupted: the move was sent, and the servos finish it; `servolink stop` stops them\n"
    before = robot.ask(lambda board: board.servo(1))
    robot.clock.run(asyncio.sleep(10.0))
    assert before.angle < robot.ask(lambda board: board.servo(1)).angle < 90, "and so they do"


def test_a_move_that_another_program_stops_has_failed(robot: Robot) -> None:
    robot.at(0.5, lambda: robot.meanwhile(lambda board: board.stop()))
    said = robot("move", "1=-90", "--duration", "1.5", "--start")
    assert (said.code, said.out) == (1, "")
    assert "not at -90, 1 s after it should have arrived: it may be stopped" in said.err


@pytest.mark.parametrize(("command", "by"), [(("release",), "\x03"), (("teach", "Wave", "1"), signal.SIGTERM)])
def test_a_question_is_not_answered(command: tuple[str, ...], by: str | signal.Signals) -> None:
    said = in_terminal("-b", "virtual://", *command, later=("[y/N]", by))
    assert said.code == 130
    assert said.out.splitlines()[-1] == "interrupted: nothing was released"


def test_the_end_of_input_is_a_no() -> None:
    said = in_terminal("-b", "virtual://", "release", "1", later=("Release servo 1? [y/N]", "\x04"))
    assert (said.code, said.out.splitlines()[-1]) == (1, "servolink: nothing was released")


def test_the_question_of_an_import_can_be_left(tmp_path: Path) -> None:
    file = tmp_path / "robot.servolink.json"
    save_project(file, build_project(Action(1, "Bow", ())))
    said = in_terminal("-b", "virtual://", "apply", str(file), later=("[y/N]", "\x03"))
    assert said.code == 130
    assert said.out.splitlines()[-1] == "interrupted: nothing was changed on the board"


def test_interrupted_events_have_ended_well(served: Addresses) -> None:
    listening = patient("--url", served.terminal, "events")
    assert listening.stderr is not None
    assert listening.stderr.readline() == "listening for button events; Ctrl-C ends it\n"
    said = finished(listening, signal.SIGINT)
    assert (said.code, said.out, said.err) == (0, "", "ended: no more events are shown\n")


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("events", 0),
        ("events --count 3", 130),
        ("events --seconds 30", 130),
        ("watch", 0),
        ("watch --csv watch.csv", 0),
        ("watch --seconds 30", 130),
    ],
)
def test_a_live_view_is_interrupted_only_before_the_end_that_was_set(
    command: str, code: int, robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    robot.at(1.0, lambda: signal.raise_signal(signal.SIGINT))
    said = robot(*command.split())
    assert (said.code, said.err.splitlines()[-1].partition(":")[0]) == (code, "interrupted" if code else "ended")


def test_a_board_that_does_not_answer_is_left_at_once(robot: Robot) -> None:
    robot.faults = Faults(drop=1.0)
    robot.at(0.5, lambda: signal.raise_signal(signal.SIGINT))
    said = robot("info")
    assert (said.code, said.out, said.err) == (130, "", "interrupted: no servo was moved\n")


@pytest.mark.parametrize("by", ["\x03", *sampled(Signals.ENDING.value, 1)])
def test_the_cursor_is_shown_again(by: str | signal.Signals) -> None:
    said = in_terminal("-b", "virtual://", "move", "1=90", "--duration", "300", later=("servo 1", by))
    assert said.code == 130
    assert "interrupted: the move was sent" in said.out
    assert said.out.rindex("\x1b[?25h") > said.out.rindex("\x1b[?25l")


STUBBORN = """
import asyncio, os, sys, threading
from servolink.cli import command_session
from servolink.cli.screen import terminal
command_session._PATIENCE = 1e9
async def main(interruption):
    with terminal.cleanup(lambda: os.write(1, b"restored\\n")):  # print may have been interrupted itself
        while True:
            print("working", flush=True)
            try:
                await asyncio.Event().wait()
            except asyncio.CancelledError:
                pass
            print("goes on", flush=True)
            while True:  # and keeps the loop from running
                threading.Event().wait(0.01)
sys.exit(command_session.run_interruptible(main))
"""


def test_a_second_signal_ends_what_does_not_end() -> None:
    process = processes.start([sys.executable, "-c", STUBBORN], env=environment())
    assert process.stdout is not None
    assert process.stdout.readline() == "working\n"
    process.send_signal(signal.SIGINT)
    assert process.stdout.readline() == "goes on\n"
    said = finished(process, signal.SIGTERM)
    assert (said.code, said.out, said.err) == (130, "restored\n", "interrupted: no servo was moved\n")


STUCK = """
import asyncio, sys, threading
from servolink.cli.command_session import run_interruptible
async def main(interruption):
    opening = asyncio.get_running_loop().run_in_executor(None, threading.Event().wait)
    print("opening", flush=True)
    await asyncio.shield(opening)
sys.exit(run_interruptible(main))
"""


def test_a_thread_that_never_returns_does_not_hold_it_back() -> None:
    process = processes.start([sys.executable, "-c", STUCK], env=environment())
    assert process.stdout is not None
    assert process.stdout.readline() == "opening\n"
    said = finished(process, signal.SIGINT)
    assert (said.code, said.err) == (130, "interrupted: no servo was moved\n")


@pytest.mark.parametrize("by", Signals.ENDING.value)
def test_the_demo_can_be_left_and_leaves_nothing(by: signal.Signals, tmp_path: Path) -> None:
    playing = patient("demo", TMPDIR=str(tmp_path))
    assert playing.stdout is not None
    assert any("All servos move" in line for line in playing.stdout)
    said = finished(playing, by)
    assert said.code == 130
    assert said.err == "interrupted: only the demo's own virtual board was moved\n"
    assert not list(tmp_path.glob("servolink-demo-*"))
