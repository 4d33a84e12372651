"""`servolink twin measure`: a servo moves after each yes, and what was measured is in the figure.

Module: servolink.cli.projects.measure.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from servolink.cli import command_session
from servolink.cli.projects import measure
from servolink.project import Figure, Project, ProjectFile, build_project, save_project
from servolink.protocol import Action
from servolink.twin import read_board
from tests.cli.programs import in_terminal
from tests.cli.robot import Robot
from tests.twin.figures import LIMB, figure

HIDDEN = {"speed": 240, "torque": 1.5, "stiffness": 0.3}
"""Values of the servo of the board; its lag is 5 degrees."""


def arm(**more: float) -> Figure:
    joint = {"id": "arm", "servo": 1, "shapes": [LIMB], "axis": "x", **more}
    return figure(joint, base={"mode": "fixed", "at": [0, 500, 0]})


@pytest.fixture
def file(tmp_path: Path, robot: Robot) -> Path:
    """A project with a figure that says nothing of its servo, and a board with such a body."""
    hidden, path = tmp_path / "hidden.json", tmp_path / "robot.json"
    save_project(hidden, Project(), figure=arm(mass=0.4, **HIDDEN))
    robot.board = read_board(hidden)
    save_project(path, build_project(Action.pose("Up", {1: 10}, seconds=0.5)), figure=arm())
    return path


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """Return a function that has a person give some answers to the questions in the list that it returns."""

    def answering(*given: bool | Callable[[], object]) -> list[str]:
        questions = list[str]()

        async def confirmed(question: str) -> bool:
            questions.append(question)
            answer = given[min(len(questions), len(given)) - 1]
            return answer if isinstance(answer, bool) else bool(answer() or True)

        monkeypatch.setattr(measure, "confirm_motion", confirmed)
        monkeypatch.setattr(command_session, "can_ask", lambda: True)
        return questions

    return answering


def test_a_servo_is_measured_and_kept_in_the_figure(
    robot: Robot, file: Path, answers: Callable[..., list[str]]
) -> None:
    questions = answers(True)
    said = robot("twin", "measure", str(file), "1", "--mass", "0.4", "--movements", "12")
    assert (said.code, said.err) == (0, "")
    assert questions[:2] == [
        "movement 1 of 12: servo 1 turns from 0° to 30° and back, as quickly as it can, then slowly. Now?",
        "movement 2 of 12: servo 1 turns from 0° to -30° and back, as quickly as it can, then slowly. Now?",
    ]
    assert len(questions) == 12
    kept = ProjectFile.read(file).figure
    assert kept is not None
    assert kept.body
    assert kept.body.mass == 0.4
    measured = kept.joints[0].measured
    assert measured
    assert measured.movements == 12
    assert measured.speed
    assert measured.speed[0] == pytest.approx(240, rel=0.1)
    assert measured.speed[1] < measured.speed[0] < measured.speed[2]
    assert "speed" in said.out
    assert f"{file}: written, servo 1 was moved 12 times" in said.out
    check = robot("twin", "check", str(file), "--all", "--json").json
    assert (check["basis"]["weight"], check["basis"]["speed"]) == ("written", "measured")
    assert "this rests on: weight written, strength " in robot("twin", "check", str(file), "--all").out


def test_a_no_ends_it_and_nothing_is_written(robot: Robot, file: Path, answers: Callable[..., list[str]]) -> None:
    before = file.read_bytes()
    questions = answers(False)
    said = robot("twin", "measure", str(file), "1")
    assert (said.code, said.err) == (1, f"servolink: no servo was moved, and {file} is as it was\n")
    assert len(questions) == 1
    answers(True, False)
    said = robot("twin", "measure", str(file), "1")
    assert said.code == 1
    assert said.err == f"servolink: servo 1 was moved 1 time and is back where it was; {file} is as it was\n"
    assert abs(robot.board.servos[1].position) < 2
    assert file.read_bytes() == before


def test_ctrl_c_stops_the_servo_and_says_what_was_moved(
    robot: Robot, file: Path, answers: Callable[..., list[str]]
) -> None:
    before = file.read_bytes()
    answers(True)
    robot.at(4.0, lambda: os.kill(os.getpid(), signal.SIGINT))
    said = robot("twin", "measure", str(file), "1")
    assert said.code == 130
    assert "interrupted: servo 1 was moved 2 times and was stopped on its way; " in said.err
    assert "all servos report that they are stopped and held" in said.err
    assert not robot.board.servos[1].is_start
    assert file.read_bytes() == before


def test_a_stop_of_somebody_else_ends_it(robot: Robot, file: Path, answers: Callable[..., list[str]]) -> None:
    before = file.read_bytes()
    answers(True)
    robot.at(4.0, lambda: robot.meanwhile(lambda board: board.stop()))
    said = robot("twin", "measure", str(file), "1")
    assert said.code == 1
    assert "servolink: servo 1 was moved 2 times and may be on its way still; " in said.err
    assert "stopped" in said.err
    assert file.read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "code", "why"),
    [
        ("2", 1, "servo 2 turns no part of the figure"),
        ("1 --limit -20 20", 1, "servo 1 is at 0° and may turn from -20° to 20°, without room for 30°: move it first"),
        ("1 --speed-cap 100", 1, "its cap is 100"),
        ("1 --movements 1", 2, "must be an integer from 2 to 100"),
        ("1 --yes", 2, "has no option --yes"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_moves(
    arguments: str, code: int, why: str, robot: Robot, file: Path, answers: Callable[..., list[str]]
) -> None:
    answers(True)
    said = robot("twin", "measure", str(file), *arguments.split())
    assert said.code == code
    assert why in said.err
    assert abs(robot.board.servos[1].position) < 1


def test_nobody_can_be_asked_without_a_terminal(robot: Robot, file: Path) -> None:
    for more in ([], ["--json"]):
        said = robot("twin", "measure", str(file), "1", *more)
        assert said.code == 2
        assert "each movement is asked for, which needs an interactive terminal" in said.err


def test_a_file_without_a_figure_is_one_error(robot: Robot, tmp_path: Path, answers: Callable[..., list[str]]) -> None:
    answers(True)
    save_project(tmp_path / "bare.json", Project())
    assert "has no figure" in robot("twin", "measure", str(tmp_path / "bare.json"), "1").err


def test_a_yes_that_was_typed_before_the_question_moves_nothing(file: Path) -> None:
    arguments = ("-b", f"virtual://?twin={file}", "twin", "measure", str(file), "1")
    said = in_terminal(*arguments, typed="y\n", later=("movement 1 of 8", signal.SIGINT))
    assert said.code == 130
    assert "interrupted: no servo was moved, and " in said.out
