"""`servolink project play --board`: a file moves a robot, which stores nothing of it."""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path

import pytest

from servolink.cli.projects.play import key_handler, state_of
from servolink.client import Playback
from servolink.project import build_project, save_project
from servolink.protocol import Action, Macro, MacroCommand, Step
from tests.cli.programs import in_terminal
from tests.cli.robot import Robot

WAVE = Action(1, "Wave", (Step(1, 30, 100), Step(2, -30, 50)))
BACK = Action(2, "Back", (Step(1, 0, 100),))
STRANGER = Action(3, "Stranger", (Step(9, 0, 100),))
DANCE = Macro(1, "Dance", (MacroCommand(1), MacroCommand(2)))


@pytest.fixture
def file(tmp_path: Path, robot: Robot) -> str:
    """A project to play, and servos that are at 0 degrees."""
    path = tmp_path / "robot.json"
    save_project(path, build_project(WAVE, BACK, DANCE, STRANGER))
    for servo in robot.board.servos.values():
        servo.angle = 0.0
    return str(path)


def angles(robot: Robot) -> list[int]:
    return [round(servo.angle) for servo in robot.board.servos.values()]


def test_a_pause_in_the_last_step_does_not_stay() -> None:
    playback = Playback()
    assert state_of(playback) == "to the first pose"
    playback.total_seconds = 2.0
    assert state_of(playback) == "playing"
    playback.pause()
    assert state_of(playback) == "paused"
    playback.seconds = 2.0
    assert state_of(playback) == "played"


def test_a_file_is_played_and_not_stored(robot: Robot, file: str) -> None:
    empty = robot("actions").out
    said = robot("project", "play", file, "Dance", "--board", "virtual://")
    assert (said.code, said.out) == (0, "macro 1 'Dance' is over: servos 1, 2 are at rest\n")
    assert said.err == ("servolink: macro 1 'Dance' takes 2 s and moves servos 1, 2; it is not stored on the board\n")
    assert angles(robot) == [0, -30, 0]
    assert robot("actions").out == empty


def test_as_json(robot: Robot, file: str) -> None:
    said = robot("project", "play", file, "Wave", "--board", "virtual://", "--json")
    assert said.json == {
        "kind": "action",
        "id": 1,
        "caption": "Wave",
        "duration_seconds": 1.0,
        "servo_ids": [1, 2],
        "arrived": True,
    }


def test_the_board_may_be_named_before_the_command(robot: Robot, file: str) -> None:
    assert robot("--board", "virtual://", "project", "play", file, "Wave").code == 0
    assert angles(robot) == [30, -30, 0]


@pytest.mark.parametrize("name", ["SERVOLINK_BOARD", "SERVOLINK_URL"])
def test_a_board_in_the_environment_is_not_moved(
    robot: Robot, file: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, "virtual://")
    assert "takes 1 s" in robot("project", "play", file, "Wave").out
    assert angles(robot) == [0, 0, 0]
    said = robot("project", "play", file, "Wave", "--start")
    assert (said.code, "name it with --board" in said.err) == (2, True)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("Wave", "--limit", "-20", "20"), "asks servo 1 to go to 30 degrees; its limits are -20..20"),
        (("Dance", "--speed-cap", "20"), "its cap is 20"),
        (("Stranger",), "the board has no servo 9; nothing was moved"),
        (("Nobody",), "Nobody"),
    ],
)
def test_what_is_refused_moves_nothing(robot: Robot, file: str, arguments: tuple[str, ...], words: str) -> None:
    said = robot("project", "play", file, *arguments, "--board", "virtual://")
    assert (said.code, said.out, words in said.err) == (1, "", True), said.err
    assert angles(robot) == [0, 0, 0]


def test_stopped_servos_need_an_option(robot: Robot, file: str) -> None:
    robot("stop")
    said = robot("project", "play", file, "Wave", "--board", "virtual://")
    assert (said.code, "Add --start" in said.err) == (1, True)
    assert robot("project", "play", file, "Wave", "--board", "virtual://", "--start").code == 0
    assert angles(robot) == [30, -30, 0]


@pytest.mark.skipif(sys.platform == "win32", reason="signals are those of Unix")
def test_ctrl_c_stops_the_servos_and_says_so(robot: Robot, file: str) -> None:
    robot.at(1.0, lambda: signal.raise_signal(signal.SIGINT))
    said = robot("project", "play", file, "Dance", "--board", "virtual://")
    assert (said.code, said.out) == (130, "")
    assert said.err.endswith(
        "interrupted: macro 1 'Dance' was ended: all servos report that they are stopped and held\n"
    )
    before = angles(robot)
    robot.clock.run(asyncio.sleep(5.0))
    assert angles(robot) == before


def test_a_lost_board_ends_it(robot: Robot, file: str) -> None:
    robot.at(1.0, robot.unplug)
    said = robot("project", "play", file, "Dance", "--board", "virtual://")
    assert (said.code, said.out) == (3, "")
    assert "connection was lost" in said.err


def test_keys() -> None:
    playback, ended = Playback(), list[str]()
    typed = key_handler(playback, lambda: ended.append("ended"))
    seen = []
    for text in ("x ", "\x1b[A", " ", "q ", "\x1b"):
        typed(text)
        seen.append((playback.is_paused, len(ended)))
    assert seen == [(True, 0), (True, 0), (False, 0), (False, 1), (False, 2)]


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
def test_on_a_terminal_a_bar_shows_how_far_it_is_and_q_stops(file: str) -> None:
    said = in_terminal("project", "play", file, "Dance", "-b", "virtual://", "--start", later=("playing", "q"))
    assert said.code == 130
    assert "space pauses" in said.out
    assert "of 2.0 s" in said.out
    assert "was ended: all servos report that they are stopped and held" in said.out
