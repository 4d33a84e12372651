"""Teaching a virtual board whose limbs somebody pushes and whose buttons somebody presses, as a script says.

Module: servolink.cli.motion.teach_session.
"""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from servolink.boards import Alias, Aliases, BoardProfile, BoardSettings, ProfileFile, SafetyLimits
from servolink.cli.command_session import Interruption, run_interruptible
from servolink.cli.motion.teach import _stop_on_signal
from servolink.client import Board, Servo, connect
from servolink.project import Project, load_project, save_project
from servolink.protocol import Action
from tests.cli.programs import in_terminal, started
from tests.cli.robot import Robot

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and terminals are those of Unix")

TWO_POSES = """
2.5 push 1 40
3.0 press 3
3.5 push 1 -20
3.5 push 2 15
4.0 press 3
4.5 long 3
"""


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep backups and what is rescued out of the user's folders."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    monkeypatch.chdir(tmp_path)


def are_held(robot: Robot) -> bool:
    """Tell whether all servos are started and held."""
    return all(servo.is_start and servo.is_hold for servo in robot.ask(lambda board: board.servos()))


def test_buttons_take_poses_and_a_long_press_ends(robot: Robot) -> None:
    robot.script(TWO_POSES)
    said = robot("teach", "Wave", "1", "2", "--yes")
    assert (said.code, said.err) == (0, "")
    assert said.out.splitlines()[0] == "a button of the board records a pose; a long press ends"
    assert said.out.splitlines()[-1] == "'Wave' with 2 poses is written: on the board"
    assert are_held(robot)
    first, second = robot.ask(lambda board: board.action(1)), robot.ask(lambda board: board.action(2))
    macro = robot.ask(lambda board: board.macro(1))
    assert {step.servo_id: step.degree for step in first.steps}[1] == 40
    assert {step.servo_id: step.degree for step in second.steps} == {1: -20, 2: 15}
    assert macro.macro_caption == "Wave"
    assert [command.command_id for command in macro.commands] == [1, 2]
    servos = robot.ask(lambda board: board.servos())
    assert [servo.angle for servo in servos[:2]] == [-20, 15], "held where they were left"


def test_only_the_button_that_was_named_counts_and_a_file_is_added_to(robot: Robot, tmp_path: Path) -> None:
    file = tmp_path / "robot.servolink.json"
    robot.script("2.5 press 4\n3 press 3\n3.5 long 3\n")
    said = robot("--json", "teach", "Nod", "--file", str(file), "--button", "3", "--yes")
    assert said.code == 0
    assert [sorted(one) for one in said.objects] == [
        ["degrees", "pose", "seconds"],
        ["degrees", "pose", "seconds"],
        ["undone"],
        ["name", "poses", "written"],
    ]
    assert [action.action_caption for action in load_project(file).actions] == ["Nod"]
    again = robot("teach", "Nod", "--file", str(file), "--yes")
    assert again.code == 1
    assert "there is already action 'Nod'; choose another name" in again.err
    assert are_held(robot)


# --- playing it ---------------------------------------------------------------------------------------------------


@pytest.fixture
def limp(robot: Robot) -> Robot:
    """Return a robot with limp servos, to which two poses are shown by hand."""
    robot.ask(lambda board: board.release())
    robot.script(TWO_POSES)
    return robot


def test_what_was_taught_to_limp_servos_plays(limp: Robot) -> None:
    said = limp("teach", "Wave", "1", "2", "--yes", "--play")
    assert (said.code, said.err) == (0, "")
    assert said.out.splitlines()[-1] == "macro 1 'Wave' was played"
    servos = limp.ask(lambda board: board.servos())
    assert [(servo.is_start, servo.is_hold) for servo in servos] == [(True, True), (True, True), (False, False)]
    assert [round(servo.angle) for servo in servos[:2]] == [-20, 15]


@pytest.fixture
def rex(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], BoardProfile]:
    """Give the robot a name and a profile; return what reads the profile."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    Aliases.save("rex", Alias("virtual://"))
    ProfileFile("rex").save(BoardProfile(limits=SafetyLimits(speed_cap=200)))

    def read() -> BoardProfile:
        profile = ProfileFile("rex").load()
        assert profile is not None
        return profile

    return read


def test_what_servos_do_when_they_are_started_is_kept(limp: Robot, rex: Callable[[], BoardProfile]) -> None:
    assert limp("teach", "Wave", "1", "2", "--yes", "--play").code == 0
    assert rex().settings == BoardSettings(when_started="stays")
    assert rex().evidence["when_started"].confidence == "likely"
    assert (rex().limits, rex().identity) == (SafetyLimits(speed_cap=200), None)


def test_it_is_not_played_unless_somebody_says_so(limp: Robot) -> None:
    said = limp("teach", "Wave", "1", "2", "--yes")
    assert said.out.splitlines()[-1] == "'Wave' with 2 poses is written: on the board"
    assert not any(servo.is_start for servo in limp.ask(lambda board: board.servos()))


def test_a_single_pose_is_played_and_told_to_programs(robot: Robot) -> None:
    robot.script("2.5 push 1 40\n3.0 press 3\n4.5 long 3")
    said = robot("teach", "Up", "1", "--yes", "--play", "--json")
    assert said.code == 0
    assert (said.objects[-1]["played"], said.objects[-2]["written"]) == ("Up", "on the board")


@pytest.mark.parametrize(("answer", "played"), [(True, True), (False, False)])
def test_a_person_is_asked(answer: bool, played: bool, limp: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    questions = []

    async def confirm(question: str) -> bool:
        questions.append(question)
        return answer or "Release" in question

    monkeypatch.setattr("servolink.cli.motion.teach.confirm", confirm)
    monkeypatch.setattr("servolink.cli.motion.teach.can_ask", lambda: True)
    monkeypatch.setattr("servolink.cli.command_session.confirm", confirm)
    monkeypatch.setattr("servolink.cli.command_session.can_ask", lambda: True)
    said = limp("teach", "Wave", "1", "2")
    assert ("was played" in said.out) == played
    assert questions[1:] == ["Play macro 1 'Wave' now? Its servos move; Ctrl-C stops them."]


def test_a_servo_that_turns_when_it_is_started_ends_it(
    limp: Robot, rex: Callable[[], BoardProfile], monkeypatch: pytest.MonkeyPatch
) -> None:
    set_servo = Board.set_servo

    async def jumping(self: Board, servo_id: int, *, start: bool, hold: bool) -> None:
        await set_servo(self, servo_id, start=start, hold=hold)
        if servo_id == 2 and start:
            limp.board.servos[2].angle += 4

    monkeypatch.setattr(Board, "set_servo", jumping)
    said = limp("teach", "Wave", "1", "2", "--yes", "--play")
    assert said.code == 1
    assert "servolink: servo 2 turned by itself when it was started, from 15° to 19°" in said.err
    assert "was played" not in said.out
    assert rex().settings.when_started == "turns"
    assert rex().evidence["when_started"].confidence == "certain"
    servos = limp.ask(lambda board: board.servos())
    assert not any(servo.is_start for servo in servos)
    assert all(servo.is_hold for servo in servos)


def test_it_is_the_board_that_plays(robot: Robot) -> None:
    said = robot("teach", "Wave", "--file", "x.json", "--play", "--yes")
    assert said.code == 2
    assert "`servolink project play FILE NAME` plays from a file" in said.err


# --- in a terminal --------------------------------------------------------------------------------------------------


def test_keys_take_poses_in_a_terminal(tmp_path: Path) -> None:
    file = tmp_path / "robot.servolink.json"
    server = started("virtual", "--tcp", "127.0.0.1:0", "--servos", "3")
    assert server.stdout is not None
    url = server.stdout.readline().split()[1]
    arguments = ("teach", "Sit", "--file", str(file), "--interval", "0.5")
    said = in_terminal("--url", url, *arguments, typed="y\n", later=("records a pose", "  u q"))
    assert said.code == 0
    assert "Release all servos? [y/N]" in said.out
    assert "pose 2 is forgotten" in said.out
    project = load_project(file)
    assert [action.action_caption for action in project.actions] == ["Sit 1", "Sit 2"]
    assert {step.interval for action in project.actions for step in action.steps} == {50}

    async def servos() -> tuple[Servo, ...]:
        async with connect(url) as board:
            return await board.servos()

    assert all(servo.is_start and servo.is_hold for servo in asyncio.run(servos()))


def test_a_taken_name_is_refused_without_a_question(tmp_path: Path) -> None:
    file = tmp_path / "robot.servolink.json"
    save_project(file, Project(actions=(Action(1, "Wave"),)))
    said = in_terminal("-b", "virtual://", "teach", "Wave", "--file", str(file))
    assert said.code == 1
    assert "there is already action 'Wave'" in said.out
    assert "[y/N]" not in said.out


def test_ctrl_c_holds_the_servos_again_and_writes_nothing(robot: Robot) -> None:
    held: list[int] = []
    robot.at(2.0, lambda: held.extend(servo.is_hold for servo in robot.board.servos.values()))
    robot.at(2.0, lambda: signal.raise_signal(signal.SIGINT))
    said = robot("teach", "Wave", "--yes")
    assert said.code == 130
    assert held == [0, 0, 0]
    assert said.err == "interrupted: servos 1, 2, 3 are held again; 0 poses not written\n"
    assert are_held(robot)


def test_ctrl_c_twice_gives_up(robot: Robot, capsys: pytest.CaptureFixture[str]) -> None:
    async def lost(interruption: Interruption) -> int:
        interruption.state = "servos may be limp"
        with _stop_on_signal() as stop:
            signal.raise_signal(signal.SIGINT)
            await stop.wait()
            signal.raise_signal(signal.SIGINT)
            await asyncio.Event().wait()
        return 0

    assert run_interruptible(lost) == 130
    assert capsys.readouterr().err == "interrupted: servos may be limp\n"


def test_a_lost_board_is_held_as_soon_as_it_is_back(robot: Robot) -> None:
    robot.script("2.5 press 3\n")
    robot.at(5.0, robot.unplug)
    robot.at(9.0, robot.plug_in)
    said = robot("teach", "Wave", "--yes")
    assert "servos 1, 2, 3 will be held as soon as the board is back" in said.err
    assert "the board is back, and servos 1, 2, 3 are held" in said.err
    assert said.out.splitlines()[-1] == "'Wave' with 1 pose is written: on the board"
    assert said.code == 0
    assert are_held(robot)


def test_what_cannot_be_written_to_the_board_is_kept_in_a_file(robot: Robot, tmp_path: Path) -> None:
    async def store_in_between(board: Board) -> None:
        await board.add_action(Action(5, "Wave"))

    robot.script("2.5 press 3\n3 long 3\n")
    robot.at(2.0, lambda: robot.meanwhile(store_in_between))
    said = robot("teach", "Wave", "--yes")
    assert said.code == 1
    assert "The poses are in Wave.servolink.json" in said.err
    assert load_project(tmp_path / "Wave.servolink.json").actions[0].action_caption == "Wave"
    assert are_held(robot)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["Wave", "9", "--yes"], "the board has no servo 9"),
        (["W" * 33, "--yes"], "a caption has at most 32 bytes"),
        (["Wave"], "add --yes if they may"),
        (["Wave", "--yes", "--interval", "0"], "must be from 0.1 to 327.67 seconds, not '0'"),
        (["Wave", "--yes", "--button=-1"], "must be an integer from 0 to 4294967295, not '-1'"),
        (["Wave", "--yes", "--button", "x"], "no button is captioned 'x': the board has no active joystick table"),
    ],
)
def test_what_cannot_be_taught_is_refused_before_anything_goes_limp(
    arguments: list[str], problem: str, robot: Robot
) -> None:
    said = robot("teach", *arguments)
    assert said.code in (1, 2)
    assert problem in said.err
    assert are_held(robot)
