"""Teaching a virtual board whose limbs somebody pushes and whose buttons somebody presses, as a script says."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from servolink.cli.session import Interruption, run_interruptible
from servolink.cli.teach import _gentle
from servolink.client.connect import connect
from servolink.client.servos import Servo
from servolink.project.project_file import load_project
from servolink.protocol.records import Action, Macro
from tests.cli.programs import Said, finished, in_terminal, program, started

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
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    monkeypatch.chdir(tmp_path)


@contextmanager
def board(tmp_path: Path, script: str = "", at: str = "127.0.0.1:0") -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Serve a board with 3 servos; yield its address and the program."""
    (tmp_path / "script.txt").write_text(script)
    state = ("--state", str(tmp_path / "state.json"))
    process = started("virtual", "--tcp", at, "--servos", "3", "--script", str(tmp_path / "script.txt"), *state)
    assert process.stdout is not None
    try:
        yield process.stdout.readline().split()[1], process
    finally:
        finished(process, signal.SIGINT)


def servos(url: str) -> tuple[Servo, ...]:
    """Ask a board from outside."""

    async def ask() -> tuple[Servo, ...]:
        async with connect(url) as asked:
            return await asked.servos()

    return asyncio.run(ask())


def are_held(url: str) -> bool:
    """Tell whether all servos are started and held."""
    return all(servo.is_start and servo.is_hold for servo in servos(url))


def test_buttons_take_poses_and_a_long_press_ends(tmp_path: Path) -> None:
    with board(tmp_path, TWO_POSES) as (url, _):
        said = program("--url", url, "teach", "Wave", "1", "2", "--yes")
        assert (said.code, said.err) == (0, "")
        assert said.out.splitlines()[0] == "a button of the board takes a pose; a long press ends"
        assert said.out.splitlines()[-1] == "'Wave' with 2 poses is written: on the board"
        assert are_held(url)

        async def stored() -> tuple[Action, Action, Macro]:
            async with connect(url) as asked:
                return await asked.action(1), await asked.action(2), await asked.macro(1)

        first, second, macro = asyncio.run(stored())
        assert {step.servo_id: step.degree for step in first.steps}[1] == 40
        assert {step.servo_id: step.degree for step in second.steps} == {1: -20, 2: 15}
        assert macro.macro_caption == "Wave"
        assert [command.command_id for command in macro.commands] == [1, 2]
        before = servos(url)
        assert [servo.angle for servo in before[:2]] == [-20, 15], "held where they were left"


def test_only_the_button_that_was_named_counts_and_a_file_is_added_to(tmp_path: Path) -> None:
    file = tmp_path / "robot.servolink.json"
    with board(tmp_path, "2.5 press 4\n3 press 3\n3.5 long 3\n") as (url, _):
        said = program("--url", url, "--json", "teach", "Nod", "--file", str(file), "--button", "3", "--yes")
        assert said.code == 0
        assert [sorted(one) for one in said.objects] == [
            ["degrees", "pose", "seconds"],
            ["degrees", "pose", "seconds"],
            ["undone"],
            ["name", "poses", "written"],
        ]
        assert [action.action_caption for action in load_project(file).actions] == ["Nod"]
        again = program("--url", url, "teach", "Nod", "--file", str(file), "--yes")
        assert again.code == 1
        assert "there is action 'Nod' already; take another name" in again.err
        assert are_held(url)


def test_keys_take_poses_in_a_terminal(tmp_path: Path) -> None:
    file = tmp_path / "robot.servolink.json"
    with board(tmp_path) as (url, _):
        arguments = ("teach", "Sit", "--file", str(file), "--interval", "0.5")
        said = in_terminal("--url", url, *arguments, typed="y\n", later=("takes a pose", "  u q"))
        assert said.code == 0
        assert "Release all servos? [y/N]" in said.out
        assert "pose 2 is forgotten" in said.out
        project = load_project(file)
        assert [action.action_caption for action in project.actions] == ["Sit 1", "Sit 2"]
        assert {step.interval for action in project.actions for step in action.steps} == {50}
        assert are_held(url)


def taught_until(process: subprocess.Popen[str], url: str) -> None:
    """Wait until a lesson has begun, with servos limp."""
    assert process.stdout is not None
    assert "takes a pose" in process.stdout.readline()
    while any(servo.is_hold for servo in servos(url)):
        pass


def test_ctrl_c_holds_the_servos_again_and_writes_nothing(tmp_path: Path) -> None:
    with board(tmp_path) as (url, _):
        teaching = started("--url", url, "teach", "Wave", "--yes")
        taught_until(teaching, url)
        said = finished(teaching, signal.SIGINT)
        assert said.code == 130
        assert said.err == "interrupted: servos 1, 2, 3 are held again; 0 poses were not written\n"
        assert are_held(url)


def test_ctrl_c_twice_gives_up(capsys: pytest.CaptureFixture[str]) -> None:
    async def lost(interruption: Interruption) -> int:
        interruption.state = "servos may be limp"
        with _gentle() as stop:
            signal.raise_signal(signal.SIGINT)
            await stop.wait()
            signal.raise_signal(signal.SIGINT)
            await asyncio.Event().wait()
        return 0

    assert run_interruptible(lost) == 130
    assert capsys.readouterr().err == "interrupted: servos may be limp\n"


def test_a_lost_board_is_held_as_soon_as_it_is_back(tmp_path: Path) -> None:
    with board(tmp_path, "2.5 press 3\n") as (url, first):
        teaching = started("--url", url, "teach", "Wave", "--yes")
        assert teaching.stdout is not None
        assert teaching.stderr is not None
        assert "takes a pose" in teaching.stdout.readline()
        assert teaching.stdout.readline().startswith("pose 1, ")
        finished(first, signal.SIGINT)
        while "servos 1, 2, 3 will be held as soon as the board is back" not in teaching.stderr.readline():
            pass
    with board(tmp_path, at=url.removeprefix("tcp://")):
        asyncio.run(release_all(url))
        said = finished(teaching)
        assert "the board is back, and servos 1, 2, 3 are held" in said.err
        assert said.out == "'Wave' with 1 poses is written: on the board\n"
        assert said.code == 0
        assert are_held(url)


async def release_all(url: str) -> None:
    """Let a board be as limp as it may be after a power cycle."""
    async with connect(url) as asked:
        await asked.release()


def test_what_cannot_be_written_to_the_board_is_kept_in_a_file(tmp_path: Path) -> None:
    with board(tmp_path, "2.5 press 3\n3 long 3\n") as (url, _):
        teaching = started("--url", url, "teach", "Wave", "--yes")
        taught_until(teaching, url)
        asyncio.run(store_in_between(url))
        said = finished(teaching)
        assert said.code == 1
        assert "What was taught is in Wave.servolink.json" in said.err
        assert load_project(tmp_path / "Wave.servolink.json").actions[0].action_caption == "Wave"
        assert are_held(url)


async def store_in_between(url: str) -> None:
    """Take the name while the lesson goes on."""
    async with connect(url) as asked:
        await asked.add_action(Action(5, "Wave"))


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["Wave", "9", "--yes"], "the board has no servo 9"),
        (["W" * 33, "--yes"], "a caption has at most 32 bytes"),
        (["Wave"], "say --yes if they may"),
        (["Wave", "--yes", "--interval", "0"], "'0' is outside 0.1..327.67 seconds"),
        (["Wave", "--yes", "--button", "x"], "'x' is no whole number from 0 to 4294967295"),
    ],
)
def test_what_cannot_be_taught_is_refused_before_anything_goes_limp(
    arguments: list[str], problem: str, tmp_path: Path
) -> None:
    with board(tmp_path) as (url, _):
        said: Said = program("--url", url, "teach", *arguments)
        assert said.code in (1, 2)
        assert problem in said.err
        assert are_held(url)
