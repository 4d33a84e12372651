"""Servos and records by caption, and `run --wait`.

Modules: servolink.cli.motion.move, servolink.cli.motion.run.
"""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path

import pytest

from servolink.client import Board
from servolink.project import Project, build_project, load_project, save_project
from servolink.protocol import Action, Button, JoystickTable, Macro, MacroCommand, ServoParameter, Step
from servolink.virtual import BoardKind
from tests.cli.programs import call
from tests.cli.robot import Robot
from tests.cli.terminals import in_terminal


@pytest.fixture
def named(robot: Robot) -> Robot:
    """Store a robot with names on the board."""

    async def prepare(board: Board) -> None:
        await board.add_servo_parameters([ServoParameter(1, 0, "hip"), ServoParameter(2, 0, "a=b")])
        await board.add_action(Action(1, "Wave", (Step(1, 30, 50), Step(2, -30, 100))))
        await board.add_action(Action(2, "3", ()))
        await board.add_macro(Macro(1, "Dance", (MacroCommand(1), MacroCommand(500, 1))))
        await board.add_macro(Macro(2, "Broken", (MacroCommand(9),)))
        await board.add_macro(Macro(3, "Itself", (MacroCommand(3, 2),)))
        await board.add_joystick_table(JoystickTable(1, "Pad", (Button(7, "A", 1),)))
        await board.set_servo(255, start=True, hold=True)

    robot.ask(prepare)
    return robot


def angles(robot: Robot) -> list[int]:
    """Return the angles of all servos."""
    return [round(servo.angle) for servo in robot.board.servos.values()]


def test_servos_are_moved_by_name(named: Robot) -> None:
    said = named("move", "hip=30", "a=b=-10", "3=5", "--duration", "0.1", "--json")
    assert [servo["servo_id"] for servo in said.json["servos"]] == [1, 2, 3]
    assert angles(named) == [30, -10, 5]
    assert named("move", "all=0", "--duration", "0.1").code == 0
    assert angles(named) == [0, 0, 0]


def test_what_may_be_meant_is_listed_in_the_order_of_ids(robot: Robot) -> None:
    async def prepare(board: Board) -> None:
        for servo_id in (3, 1, 2):
            await board.add_servo_parameters([ServoParameter(servo_id, 0, "hip" if servo_id > 1 else "knee")])

    robot.ask(prepare)
    assert "'hip' may be servo 2 'hip' or servo 3 'hip'; give the id" in robot("move", "hip=3").err
    said = robot("move", "arm=3")
    assert "there is servo 1 'knee', servo 2 'hip' and servo 3 'hip'" in said.err


def test_captions_are_shown_where_one_was_given(named: Robot) -> None:
    said = named("move", "Hip=30", "3=5", "--duration", "0.1")
    assert [line.split() for line in said.out.splitlines()] == [
        ["servo", "caption", "from", "target", "now"],
        ["1", "hip", "2°", "30°", "30°"],
        ["3", "6°", "5°", "5°"],
    ]
    by_id = named("move", "1=0", "--no-wait", "--duration", "0.1")
    assert by_id.out.split() == ["servo", "from", "target", "1", "30°", "0°"]
    moved = named("move", "hip=3", "3=5", "--duration", "0.1", "--json").json["servos"]
    assert [servo["servo_caption"] for servo in moved] == ["hip", None]
    assert named("move", "1=3", "--duration", "0.1", "--json").json["servos"][0]["servo_caption"] is None
    for command in ("release hip --yes", "servo start hip"):
        lines = named(*command.split()).out.splitlines()
        assert [line.split()[:2] for line in lines] == [["servo", "caption"], ["1", "hip"], ["2", "a=b"], ["3", "5°"]]
    assert "caption" not in named("servo", "hold", "1").out


def test_ids_are_not_looked_up(named: Robot) -> None:
    named.board.kind = BoardKind(unsupported=("QueryServoParameter",))
    for command in ("move 1=3 --start", "release 1 --yes", "servo start 1", "servo hold all"):
        assert named(*command.split()).code == 0


def test_servos_are_released_by_name(named: Robot) -> None:
    assert named("release", "HIP", "1", "--yes").code == 0
    assert [servo.is_hold for servo in named.board.servos.values()] == [False, True, True]
    assert named("release", "all", "--yes").code == 0
    assert not any(servo.is_hold for servo in named.board.servos.values())


@pytest.mark.parametrize(
    ("command", "line"),
    [
        ("actions wave", "action 1 'Wave'"),
        ("actions name:3", "action 2 '3'"),
        ("macros DANCE", "macro 1 'Dance'"),
        ("tables Pad", "joystick table 1 'Pad'"),
    ],
)
def test_records_are_shown_by_name(command: str, line: str, named: Robot) -> None:
    said = named(*command.split())
    assert (said.code, said.out.splitlines()[0]) == (0, line)


@pytest.mark.parametrize(
    ("command", "text"),
    [
        ("move hop=3", "the board has no servo 'hop'; did you mean servo 1 'hip'?"),
        ("release hop --yes", "the board has no servo 'hop'; did you mean servo 1 'hip'?"),
        ("run macro Danse", "the board has no macro 'Danse'; did you mean macro 1 'Dance'?"),
        ("run action 7", "the board has no action 7"),
        ("actions Bow", "the board has no action 'Bow'; there is action 1 'Wave' and action 2 '3'"),
        ("move hip=3 1=4", "servo 1 is given twice: as 'hip' and as 1"),
        ("teach x hop --yes", "the board has no servo 'hop'; did you mean servo 1 'hip'?"),
        ("teach x --button B --yes", "the board has no button 'B'; there is button 7 'A'"),
    ],
)
def test_an_unknown_name_moves_nothing(command: str, text: str, named: Robot) -> None:
    said = named(*command.split())
    assert (said.code, said.out, said.err) == (1, "", f"servolink: {text}\n")
    assert all(servo.is_hold for servo in named.board.servos.values())


def test_records_of_a_file_are_renamed_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "robot.json"
    project = build_project(Action(1, "Bow", ()))
    save_project(path, Project(servo_parameters=(ServoParameter(1, 0, "hip"),), actions=project.actions))
    assert call(capsys, "project", "rename", str(path), "action", "bow", "Nod", "--in-place").code == 0
    assert call(capsys, "project", "rename", str(path), "servo", "hip", "knee", "--in-place").code == 0
    renamed = load_project(path)
    assert (renamed.actions[0].action_caption, renamed.servo_parameters[0].servo_caption) == ("Nod", "knee")
    said = call(capsys, "project", "rename", str(path), "servo", "hip", "x", "--in-place")
    assert (said.code, said.err) == (1, "servolink: there is no servo 'hip'; there is servo 1 'knee'\n")


# --- waiting ------------------------------------------------------------------------------------------------------


def test_a_run_is_waited_for(named: Robot) -> None:
    assert named("run", "macro", "dance", "--wait").out == "macro 1 'Dance' is over: servos 1, 2 are at rest\n"
    assert angles(named)[:2] == [30, -30]
    said = named("run", "action", "Wave", "--wait", "--json").json
    assert (said["action_id"], said["duration_seconds"], said["servo_ids"], said["arrived"]) == (1, 1.0, [1, 2], True)
    assert named("run", "action", "name:3", "--wait").out == "action 2 '3' is over\n"


def test_a_servo_that_would_not_arrive_is_started_first_or_the_run_refused(named: Robot) -> None:
    named.ask(lambda board: board.release(2))
    said = named("run", "action", "Wave", "--wait")
    assert (said.code, said.out) == (1, "")
    assert "servo 2 is stopped or released and would ignore the movement; nothing was sent. Add --start" in said.err
    assert named("run", "action", "Wave", "--wait", "--start").code == 0
    assert angles(named)[:2] == [30, -30]


def test_servos_that_do_not_arrive_are_named(named: Robot) -> None:
    named.at(0.2, lambda: named.meanwhile(lambda board: board.stop()))
    said = named("run", "macro", "Dance", "--wait")
    assert (said.code, said.out) == (1, "")
    assert ", not at 30; servo 2 is at " in said.err
    assert "1 s after they should have arrived: they may be stopped" in said.err


@pytest.mark.parametrize(
    ("record", "text"),
    [
        ("Broken", "macro 2 'Broken' was not run: macro 2 'Broken' runs action 9, which could not be read"),
        ("Itself", "macro 3 'Itself' was not run, because its end could not be known: macro 3 'Itself' never ends"),
    ],
)
def test_what_cannot_be_waited_for_is_not_run(record: str, text: str, named: Robot) -> None:
    said = named("run", "macro", record, "--wait")
    assert (said.code, said.out) == (1, "")
    assert said.err.startswith(f"servolink: {text}")


@pytest.mark.skipif(sys.platform == "win32", reason="signals are those of Unix")
def test_an_interrupted_run_is_stopped(named: Robot) -> None:
    named.at(0.4, lambda: signal.raise_signal(signal.SIGINT))
    said = named("run", "macro", "Dance", "--wait")
    assert (said.code, said.out) == (130, "")
    assert said.err == "interrupted: macro 1 'Dance' was ended: all servos report that they are stopped and held\n"
    assert not any(servo.is_start for servo in named.board.servos.values())
    before = angles(named)
    named.clock.run(asyncio.sleep(3.0))
    assert angles(named) == before


@pytest.mark.skipif(sys.platform == "win32", reason="signals are those of Unix")
def test_an_interrupted_run_says_if_the_stop_is_not_confirmed(named: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    async def stop(board: Board) -> None:
        await asyncio.sleep(60.0)

    monkeypatch.setattr(Board, "stop", stop)
    named.at(0.4, lambda: signal.raise_signal(signal.SIGINT))
    said = named("run", "macro", "Dance", "--wait")
    assert (said.code, said.out) == (130, "")
    assert said.err == (
        "interrupted: macro 1 'Dance' was started, and a stop was not confirmed; run `servolink stop`\n"
    )


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
def test_bars_show_how_far_a_run_is(tmp_path: Path) -> None:
    url = f"virtual://?state={tmp_path / 'board.json'}"
    path = tmp_path / "robot.json"
    save_project(path, build_project(Action(1, "Wave", (Step(1, 30, 30),))))
    assert in_terminal("-b", url, "apply", str(path), "--yes").code == 0
    said = in_terminal("-b", url, "run", "action", "Wave", "--wait", "--start")
    assert said.code == 0
    assert "of 0.3 s" in said.out
    assert "action 1 'Wave' is over: servo 1 is at rest" in said.out
