"""Export, plan, apply and rollback from the shell, over a real terminal and TCP."""

from __future__ import annotations

import asyncio
import signal
from pathlib import Path

import pytest

from servolink.client import Board, connect
from servolink.project import UNFINISHED, Project, load_project, save_project
from servolink.protocol import Action, Button, JoystickTable, Macro, MacroCommand, ServoParameter, Step
from servolink.transports import Faults
from tests.cli import terminals
from tests.cli.conftest import Addresses
from tests.cli.programs import Said, call, in_terminal
from tests.cli.robot import Robot

BEFORE = Project(
    7,
    (ServoParameter(2, 5, "left knee"),),
    (Action(1, "Bow", (Step(1, 30, 50), Step(2, -30, 100))), Action(2, "Old", ())),
    (Macro(4, "Greet", (MacroCommand(1, total_interval=1000), MacroCommand(500, 1, total_interval=500))),),
    (JoystickTable(3, "Pad", (Button(7, "greet", button_press_macro=4),)),),
    3,
)
AFTER = Project(
    8,
    BEFORE.servo_parameters,
    (Action(1, "Bow", (Step(1, 35, 50), Step(2, -30, 100))), Action(9, "New", (Step(3, 1, 1),))),
    BEFORE.macros,
    BEFORE.joystick_tables,
    3,
)
ON_ONE_LINE = pytest.mark.parametrize("url", ["network"], indirect=True)
"""For programs in a terminal: what they ask and how they end does not depend on the line to the board."""


@pytest.fixture(autouse=True)
def data_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where backups go, here and in programs."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return tmp_path / "data" / "servolink"


@pytest.fixture
def after(tmp_path: Path) -> str:
    """A file with AFTER in it."""
    save_project(tmp_path / "after.servolink.json", AFTER)
    return str(tmp_path / "after.servolink.json")


@pytest.fixture(params=["terminal", "network"])
def url(request: pytest.FixtureRequest, served: Addresses) -> str:
    """A board with BEFORE on it, over a pseudo-terminal and over TCP."""
    asyncio.run(_set_up(served.network))
    return str(getattr(served, request.param))


async def _set_up(network: str) -> None:
    async with connect(network) as board:
        await fill(board)


async def fill(board: Board) -> None:
    """Put BEFORE on a board."""
    await board.clear_all_data()
    await board.write_project_id(BEFORE.project_id)
    await board.add_servo_parameters(BEFORE.servo_parameters)
    for action in BEFORE.actions:
        await board.add_action(action)
    await board.add_macro(BEFORE.macros[0])
    await board.add_joystick_table(BEFORE.joystick_tables[0])
    await board.set_active_joystick_table(3)


class Shell:
    """Runs commands on one board."""

    def __init__(self, url: str, capsys: pytest.CaptureFixture[str]) -> None:
        self.url = url
        self._capsys = capsys

    def __call__(self, *arguments: str) -> Said:
        return call(self._capsys, "--url", self.url, *arguments)


@pytest.fixture
def shell(url: str, capsys: pytest.CaptureFixture[str]) -> Shell:
    """Commands on that board."""
    return Shell(url, capsys)


def test_export_writes_everything_into_a_file(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "robot.servolink.json"
    said = shell("export", str(file))
    assert said.code == 0
    assert said.out == f"{file}: project 7, 1 servo parameter, 2 actions, 1 macro, 1 joystick table\n"
    assert said.err == "", "progress is shown on a terminal only"
    assert load_project(file) == BEFORE
    assert shell("--json", "export", str(file), "--yes").json["actions"] == 2
    assert shell("plan", str(file)).out == "0 differences: the board holds this project\n"


def test_export_asks_before_it_replaces_a_project(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "robot.servolink.json"
    save_project(file, AFTER)
    for options in ((), ("--json",)):
        refused = shell("export", str(file), *options)
        assert (refused.code, refused.out) == (2, "")
        assert f"{file} exists; --yes replaces it" in refused.err
    for answer in ("n\n", "\x04"):
        left = terminals.in_terminal("--url", shell.url, "export", str(file), typed=answer)
        assert left.code == 1
        assert "exists. Replace it? [y/N]" in " ".join(left.out.split())
        assert "was not written" in left.out
    assert load_project(file) == AFTER
    assert terminals.in_terminal("--url", shell.url, "export", str(file), typed="y\n").code == 0
    assert load_project(file) == BEFORE


def test_export_does_not_write_over_what_is_no_project(shell: Shell, tmp_path: Path) -> None:
    diary = tmp_path / "diary.txt"
    diary.write_text("dear diary")
    said = shell("export", str(diary))
    assert said.code == 1
    assert "is not a project file, so it is not overwritten; choose another name" in said.err
    assert diary.read_text() == "dear diary"


def test_plan_shows_what_would_change_and_what_it_costs(shell: Shell, after: str) -> None:
    said = shell("plan", after)
    assert said.code == 1
    differences, _, costs = said.out.partition("\n\n")
    assert differences.splitlines() == [
        "~ project id: 7 -> 8",
        "~ action 1 'Bow'",
        "    - step 1: servo 1 to 30 in 0.5 s",
        "    + step 1: servo 1 to 35 in 0.5 s",
        "- action 2 'Old': 0 steps, 0 s",
        "+ action 9 'New': 1 step, 0.01 s",
    ]
    assert [line.split("  ")[0] for line in costs.splitlines()] == [
        "differences",
        "transfer",
        "takes about",
        "memory free",
    ]
    described = shell("plan", "--json", after).json
    assert [change["change"] for change in described["changes"]] == ["changed", "changed", "removed", "added"]
    assert described["changes"][3]["new"]["steps"] == [{"servo_id": 3, "degree": 1, "interval_ms": 10}]
    assert described["memory"]["free_before_bytes"] - described["memory"]["free_after_bytes"] == 5


@pytest.mark.parametrize("how", [[], ["--replace"]], ids=["differences", "replace"])
def test_apply_writes_the_project_and_rollback_brings_the_old_one_back(
    shell: Shell, after: str, how: list[str], tmp_path: Path, data_folder: Path
) -> None:
    said = shell("apply", "--yes", *how, after)
    assert said.code == 0
    assert "done, and verified: each record was read back from the board" in said.out
    assert said.err == ""
    assert shell("plan", after).code == 0
    (backup,) = shell("--json", "backups").json["backups"]
    assert Path(backup["file"]).parent == data_folder / "backups"
    assert load_project(Path(backup["file"])) == BEFORE
    assert shell("backups").out.splitlines()[1].split()[0] == str(backup["number"]) == "1"
    assert f"in {data_folder / 'backups'}; `servolink rollback NUMBER` restores one" in shell("backups").out
    back = shell("rollback", "--yes")
    assert back.code == 0
    assert back.out.startswith(f"from {backup['file']}\n~ project id: 8 -> 7\n")
    file = tmp_path / "now.servolink.json"
    shell("export", str(file))
    assert load_project(file) == BEFORE
    for name in (backup["file"], "1", "000001"):
        named = shell("--json", "rollback", "--yes", name)
        assert named.json == {"changed": False, "plan": named.json["plan"]}
    assert "there is no backup 7; `servolink backups` lists all backups" in shell("rollback", "--yes", "7").err


def test_apply_does_nothing_unasked(shell: Shell, after: str) -> None:
    said = shell("apply", after)
    assert said.code == 2
    assert "no terminal for the question; --yes continues without asking" in said.err
    said = shell("apply", "--json", after)
    assert said.code == 2
    assert "--json needs --yes, because it asks nothing" in said.err
    assert shell("plan", after).code == 1


def test_no_backup_must_be_spelled_out(shell: Shell, after: str, data_folder: Path) -> None:
    assert shell("apply", "--yes", "--no-back", after).code == 2
    assert shell("apply", "--yes", "--no-backup", after).code == 0
    assert not (data_folder / "backups").exists()
    assert "there are no backups in" in shell("backups").out


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("n\n", 1), ("\x04", 1)])
def test_apply_asks_on_a_terminal(shell: Shell, after: str, answer: str, code: int) -> None:
    said = terminals.in_terminal("--url", shell.url, "apply", after, typed=answer)
    assert said.code == code, "or what depends on it would go on"
    assert "write this to the board, and delete action 2 from it? [y/N]" in " ".join(said.out.split())
    assert ("nothing was changed on the board" in said.out) == (code == 1)
    assert shell("plan", after).code == code


@ON_ONE_LINE
@pytest.mark.parametrize("keys", ["\x03", "\x03\x03"], ids=["once", "twice"])
def test_ctrl_c_ends_the_question(shell: Shell, after: str, keys: str) -> None:
    said = in_terminal("--url", shell.url, "apply", after, later=("? [y/N]", keys))
    if keys == "\x03":
        assert said.code == 130
        assert "interrupted: nothing was changed on the board" in said.out
    else:
        # The second may find a program that has ended but for Python itself, which then ends by the signal: for a
        # shell this is 130 too. It also takes what was just written out of the terminal's buffer.
        assert said.code in {130, -signal.SIGINT}


def test_a_missing_file_is_reported_before_a_missing_terminal(shell: Shell, tmp_path: Path) -> None:
    said = shell("apply", str(tmp_path / "nofile.json"))
    assert (said.code, "nofile.json: cannot be read" in said.err) == (1, True)


@ON_ONE_LINE
@pytest.mark.parametrize("command", ["apply", "rollback"])
def test_what_was_agreed_to_is_done_and_nothing_else(
    shell: Shell, after: str, command: str, served: Addresses, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    elsewhere = Shell(served.network, capsys)
    other = str(tmp_path / "other.servolink.json")
    save_project(Path(other), Project(9))
    if command == "rollback":
        assert shell("apply", "--yes", after).code == 0
    said = in_terminal(
        *("--url", shell.url, command, *([after] if command == "apply" else [])),
        later=("? [y/N]", "y\n"),
        meanwhile=lambda: elsewhere("apply", "--yes", other),
    )
    assert said.code == 1
    assert "changed before the answer, and so did the plan" in " ".join(said.out.split())
    assert shell("plan", other).code == 0


def test_every_command_says_once_that_an_import_is_unfinished(
    shell: Shell, after: str, served: Addresses, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    exported = tmp_path / "exported"

    async def begin() -> None:
        async with connect(served.network) as board:
            await board.write_project_id(UNFINISHED.start + 3)

    asyncio.run(begin())
    said = shell("servos")
    assert said.code == 0
    assert "holds an unfinished import: `servolink apply FILE` finishes it, `servolink rollback` undoes" in said.err
    assert shell("events", "--seconds", "0.05").err.count("unfinished import") == 1
    assert not caplog.messages, "the log would say the same"
    assert "an import is unfinished" in shell("info").out
    assert shell("--json", "info").json["has_unfinished_import"]
    assert "with a lost journal" in shell("rollback", "--yes").err
    assert shell("export", str(exported)).code == 0
    assert load_project(exported).project_id == 0, "or applying the file would say that an import is unfinished"
    assert shell("apply", "--yes", after).code == 0
    assert shell("servos").err == ""


def test_ctrl_c_stops_at_a_safe_point_and_says_which(robot: Robot, after: str) -> None:
    async def interrupt_writing(board: Board) -> None:
        while not await board.has_unfinished_import():
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.1)
        signal.raise_signal(signal.SIGINT)

    robot.ask(fill)
    robot.faults = Faults(delay=1.0, delay_time=0.02)
    robot.at(0.1, lambda: robot.meanwhile(interrupt_writing))
    said = robot("apply", "--yes", after)
    assert said.code == 130
    interrupted = said.err.splitlines()[-1]
    assert interrupted.startswith("interrupted: the board holds an unfinished import, stopped while writing, at ")
    assert "the same command finishes it, `servolink rollback` undoes it" in interrupted
    again = robot("--json", "apply", "--yes", after)
    assert again.code == 0
    assert again.json["resumed"]
    assert robot("plan", after).code == 0
