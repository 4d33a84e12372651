"""Completion: what may follow on a command line, and scripts that are tried in the shells that are here.

Module: servolink.cli.first_steps.complete.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from servolink import boards, transports
from servolink.boards import Alias, Aliases
from servolink.cli.index import below, index
from servolink.project import BackupStore, Project
from servolink.protocol import Action, Macro, MacroCommand, ServoParameter, Step
from servolink.transports import DeviceInfo
from tests import processes
from tests.cli.programs import COMMAND, call

BOW = Action(1, "Bow", (Step(1, 30, 5),))
DEEP_BOW = Action(2, "Deep bow", (Step(1, 60, 5),))
NOD = Macro(1, "Nod", (MacroCommand(1),))
STORED = Project(actions=(BOW, DEEP_BOW), macros=(NOD,), servo_parameters=(ServoParameter(3, 0, "left hip"),))


@pytest.fixture(autouse=True)
def _boards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A board with a name, saved before an import, and a port."""
    for name in ("XDG_RUNTIME_DIR", "XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    monkeypatch.setattr(transports, "serial_devices", lambda: [DeviceInfo("serial:///dev/ttyACM7", "port")])
    monkeypatch.setattr(boards, "announced_boards", list)
    Aliases.save("rex", Alias("tcp://127.0.0.1:7878"))
    BackupStore().keep(STORED, "tcp://127.0.0.1:7878?byte_order=big", "utf-8")


def possible(capsys: pytest.CaptureFixture[str], *words: str) -> list[str] | None:
    """Return what may stand in place of the last word; None if the name of a file may."""
    said = call(capsys, "complete", "zsh", "--", *words)
    assert said.err == ""
    return None if said.code else said.out.splitlines()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["mo"], ["move"]),
        (["move", "--du"], ["--duration"]),
        (["project", "sch"], ["schema"]),
        (["info", "--byte-order", "l"], ["little"]),
        (["info", "--byte-order=b"], ["--byte-order=big"]),
        (["--board", "re"], ["rex"]),
        (["-b", ""], ["rex", "serial:///dev/ttyACM7"]),
        (["info", "--url", "serial"], ["serial:///dev/ttyACM7"]),
        (["use", "--remove", ""], ["rex", "serial:///dev/ttyACM7"]),
        (["--board", "rex", "move", ""], ["left hip="]),
        (["move", "-b", "rex", "1=30", "left"], ["left hip="]),
        (["release", "--board=rex", ""], ["left hip"]),
        (["run", ""], ["action", "macro"]),
        (["run", "action", "-b", "rex", ""], ["Bow", "Deep bow"]),
        (["--board", "rex", "run", "macro", ""], ["Nod"]),
        (["-b", "rex", "macro", "show", ""], ["Nod"]),
        (["-b", "rex", "action", "delete", "Bow", "D"], ["Deep bow"]),
        (["-b", "tcp://127.0.0.1:7878", "actions", ""], ["Bow", "Deep bow"]),
        (["-b", "virtual://", "move", ""], []),
        (["help", "fl"], ["fleet"]),
        (["help", "fleet", "jo"], ["join"]),
        (["info", "more", ""], []),
        (["stop", ""], []),
        (["nonsense", "--nothing", ""], []),
        (["plan", "rob"], None),
        (["apply", "--no-backup", ""], None),
        (["record", "out.mcap", ""], []),
    ],
)
def test_words_are_completed(words: list[str], expected: list[str] | None, capsys: pytest.CaptureFixture[str]) -> None:
    assert possible(capsys, *words) == expected


def test_every_option_and_subcommand_is_offered(capsys: pytest.CaptureFixture[str]) -> None:
    for name in index():
        assert possible(capsys, *name.split(), "-") == [*index()[name].options]
    assert possible(capsys, "") == [name for name, entry in below("").items() if entry.topic]
    assert possible(capsys, "fleet", "") == [*below("fleet")]


def test_the_board_of_the_session_is_used(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert possible(capsys, "move", "") == []
    monkeypatch.setenv("SERVOLINK_BOARD", "rex")
    assert possible(capsys, "move", "") == ["left hip="]


def test_the_only_board_here_is_used(capsys: pytest.CaptureFixture[str]) -> None:
    BackupStore().keep(Project(actions=(BOW,)), "serial:///dev/ttyACM7", "utf-8")
    assert possible(capsys, "run", "action", "") == ["Bow"]


def test_damaged_files_and_broken_libraries_complete_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken() -> list[DeviceInfo]:
        raise RuntimeError("no library")

    monkeypatch.setattr(transports, "serial_devices", broken)
    assert possible(capsys, "-b", "") == ["rex"]
    for backup in BackupStore().backups():
        backup.path.chmod(0o600)
        backup.path.write_bytes(b"{")
    Aliases.path().write_bytes(b"\xff")
    assert possible(capsys, "-b", "") == []
    assert possible(capsys, "-b", "rex", "move", "") == []


def test_texts_that_could_take_over_a_terminal_are_not_offered(capsys: pytest.CaptureFixture[str]) -> None:
    captions = ("\x1b]0;owned\x07", "two\nlines", "tab\there", "fine")
    actions = tuple(Action(number, caption, BOW.steps) for number, caption in enumerate(captions, 1))
    BackupStore().keep(Project(actions=actions), "tcp://127.0.0.1:7878", "utf-8")
    assert possible(capsys, "-b", "rex", "run", "action", "") == ["fine"]


# --- in shells --------------------------------------------------------------------------------------------------------

IN_BASH = """
source "$1"
COMP_LINE=$2 COMP_POINT=${#2}
compopt() { echo "compopt $*"; }
_servolink
printf '%s\\n' "${COMPREPLY[@]}"
"""
IN_FISH = "source $argv[1]; complete --do-complete $argv[2]"
IN_ZSH = """
compdef() { : }
compadd() { while [[ $1 != -- ]] { shift }; shift; print -rl -- "$@" }
_files() { print files }
source $1
shift
words=("$@") CURRENT=$#
_servolink
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a program `servolink`, and a file."""
    (tmp_path / "robot.json").touch()
    program = tmp_path / "bin/servolink"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {" ".join(COMMAND)} "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    return tmp_path


def in_shell(folder: Path, capsys: pytest.CaptureFixture[str], shell: str, *arguments: str) -> list[str]:
    """Return what a shell prints that has the script and runs the program of this folder."""
    script = folder / "script"
    script.write_text(call(capsys, "completion", shell).out, encoding="utf-8")
    path = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
    code = [{"bash": IN_BASH, "zsh": IN_ZSH, "fish": IN_FISH}[shell], *([] if shell == "fish" else [shell])]
    env = {**os.environ, "PATH": path, "PYTHONPATH": str(Path(__file__).parents[3])}
    ran = processes.run([shell, "-c", *code, str(script), *arguments], cwd=folder, env=env)
    assert ran.stderr == ""
    return [line for line in ran.stdout.splitlines() if line]


@pytest.mark.skipif(shutil.which("bash") is None, reason="completes in bash")
@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("servolink mo", ["move"]),
        pytest.param("servolink project sch", ["schema"], marks=pytest.mark.slow),
        ("FOO=1 servolink plan rob", ["compopt -o default"]),
        ("servolink -b rex move lef", ["compopt -o nospace", r"left\ hip="]),
        pytest.param(r"servolink -b rex move left\ h", ["compopt -o nospace", r"left\ hip="], marks=pytest.mark.slow),
        pytest.param("servolink -b rex run action Deep", [r"Deep\ bow"], marks=pytest.mark.slow),
        ("servolink -b rex run action 'Deep", []),
        pytest.param("servolink --byte-order=l", ["little"], marks=pytest.mark.slow),
        ("servolink -b tcp://127.0.0.1:7878 run macro ", ["Nod"]),
        ("servolink -b rex run action ';", []),
    ],
)
def test_bash_completes(typed: str, expected: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert in_shell(folder, capsys, "bash", typed) == expected


@pytest.mark.skipif(shutil.which("bash") is None, reason="completes in bash")
def test_hostile_captions_run_nothing_in_bash(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    captions = ("$(touch owned)", "`touch owned`", "; touch owned", "a'b\"c\\d", "-rf *", "~root", "!!")
    actions = tuple(Action(number, caption, BOW.steps) for number, caption in enumerate(captions, 1))
    BackupStore().keep(Project(actions=actions), "tcp://127.0.0.1:7878", "utf-8")
    for words in in_shell(folder, capsys, "bash", "servolink -b rex run action "):
        ran = processes.run(["bash", "-c", f"printf %s {words}"], cwd=folder)
        assert ran.stdout in captions
    assert not (folder / "owned").exists()


@pytest.mark.skipif(shutil.which("zsh") is None, reason="completes in zsh")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["mo"], ["move"]),
        (["plan", "rob"], ["files"]),
        (["-b", "rex", "move", r"left\ h"], ["left hip="]),
        (["-b", "rex", "run", "action", ""], ["Bow", "Deep bow"]),
    ],
)
def test_zsh_completes(words: list[str], expected: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert in_shell(folder, capsys, "zsh", "servolink", *words) == expected


@pytest.mark.skipif(shutil.which("fish") is None, reason="completes in fish")
@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("servolink mo", ["move"]),
        ("servolink plan rob", ["robot.json"]),
        ("servolink -b rex run action Dee", ["Deep bow"]),
    ],
)
def test_fish_completes(typed: str, expected: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert in_shell(folder, capsys, "fish", typed) == expected
