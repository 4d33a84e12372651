"""`servolink project show`: projects as people and as programs read them.

Module: servolink.cli.projects.show_project.
"""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest

from servolink.project import Project, save_project
from servolink.protocol import ACTION, Action, Button, JoystickTable, Macro, MacroCommand, ServoParameter
from servolink.virtual import VirtualBoard, save_state
from tests.cli.programs import call
from tests.cli.terminals import in_terminal
from tests.project.projects import HUMANOID

SHOWN = """\
project id      77
size            482 bytes on a board
joystick table  7

servo  caption         correction
    1  left shoulder            3
    2  right shoulder          -2
    3  L elbow                  0
    4  R elbow                  0
    5  neck                     0

action  caption         seconds  angles
     1  Raise left arm      0.5  1: 60, 3: -30 in 0.4 s, 5: 10 in 0.2 s
     2  Nod                 0.3  5: 20

macro  caption    seconds  does
    4  Wave left      2.3  Raise left arm 2 times at 50 %, wait 0.3 s
    5  Show           2.6  Wave left, Nod

table  caption  button  caption  press      long press  up
    7  Pad           1  wave     Wave left              Show
"""


@pytest.fixture
def file(tmp_path: Path) -> str:
    """A project with a bit of everything."""
    path = tmp_path / "robot.servolink.json"
    save_project(path, HUMANOID)
    return str(path)


def test_all_of_it(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "project", "show", file)
    assert (said.code, said.out, said.err) == (0, SHOWN, "")


def test_on_a_terminal(file: str) -> None:
    said = in_terminal("project", "show", file)
    assert said.code == 0
    assert "Raise left arm 2 times at 50 %, wait 0.3 s" in said.out


def test_records_whole(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "project", "show", file, "nod", "macro:4", "Pad")
    assert said.code == 0
    assert said.out.splitlines() == [
        "action 2 'Nod'",
        "servo  angle  seconds",
        "    5     20      0.3",
        "macro 4 'Wave left'",
        "does        speed %  times  seconds in all",
        "action 1         50      2             2.0",
        "wait 0.3 s      100      1             0.3",
        "joystick table 7 'Pad'",
        "button  caption  press macro  long press macro  up macro  uninterruptible",
        "     1  wave               4                           5  no",
    ]


def test_as_json(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    whole = call(capsys, "project", "show", file, "--json").json
    assert (whole["project_id"], whole["stored_bytes"], whole["active_joystick_table"]) == (77, 482, 7)
    assert whole["servo_parameters"][0] == {"servo_id": 1, "servo_caption": "left shoulder", "adjusted_degree": 3}
    assert whole["duration_seconds"] == {"actions": {"1": 0.5, "2": 0.3}, "macros": {"4": 2.3, "5": 2.6}}
    some = call(capsys, "--json", "project", "show", file, "Nod").json
    assert some == {
        "actions": [
            {
                "action_id": 2,
                "action_caption": "Nod",
                "steps": [{"servo_id": 5, "degree": 20, "interval_ms": 300}],
            }
        ],
        "macros": [],
        "joystick_tables": [],
    }


def test_a_board_is_only_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    board, state = VirtualBoard(2), tmp_path / "state"
    board.storage.put(ACTION, {3: b"\3\0\0\0" + b"Bow".ljust(32, b"\0") + b"\1\0\1\x0a\0\x14\0"})
    save_state(board, state)
    before = json.loads(state.read_text())["requests"]
    said = call(capsys, "project", "show", f"virtual://?servos=2&state={state}")
    assert said.code == 0
    assert "     3  Bow          0.2  1: 10" in said.out
    assert "project id      none" in said.out
    assert json.loads(state.read_text())["requests"] == before


@pytest.mark.parametrize("source", ["tcp://127.0.0.1:1", "serial:///nowhere"])
def test_a_board_that_cannot_be_had_is_3(source: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "project", "show", source)
    assert (said.code, said.out) == (3, "")


def test_a_file_that_cannot_be_read_is_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "project", "show", str(tmp_path / "nothing"))
    assert (said.code, said.out) == (1, "")
    assert "nothing: cannot be read" in said.err


def test_what_calls_nothing_is_shown_all_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    project = Project(
        macros=(Macro(1, "Lost", (MacroCommand(9), MacroCommand(8, 2), MacroCommand(7, 9))),),
        joystick_tables=(JoystickTable(1, "Empty"), JoystickTable(2, "Pad", (Button(3, "", 9),))),
    )
    save_project(tmp_path / "p", project, unchecked=True)
    said = call(capsys, "project", "show", str(tmp_path / "p"))
    assert said.code == 0
    assert said.out.splitlines()[4:] == [
        "macro  caption  seconds  does",
        "    1  Lost              action 9, macro 8, command of type 9: 7",
        "",
        "table  caption  button  caption  press    long press  up",
        "    1  Empty",
        "    2  Pad           3           macro 9",
    ]
    assert call(capsys, "project", "show", str(tmp_path / "p"), "--json").json["duration_seconds"]["macros"] == {
        "1": None
    }


@pytest.mark.parametrize("caption", ["\x1b[2J\x1b]0;owned\x07", "\u202etxt", "\udcff\udcfe", "[bold]x[/]"])
def test_hostile_captions_are_text(caption: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    project = Project(
        servo_parameters=(ServoParameter(1, 0, caption),),
        actions=(Action(1, caption),),
        macros=(Macro(1, caption, (MacroCommand(1),)),),
        joystick_tables=(JoystickTable(1, caption, (Button(1, caption, 1),)),),
    )
    save_project(tmp_path / "p", project, unchecked=True)
    for arguments in [(), ("action:1",), ("--json",), ("nothing",)]:
        said = call(capsys, "project", "show", str(tmp_path / "p"), *arguments)
        assert all(character == "\n" or character.isprintable() for character in said.out + said.err)
    assert (
        call(capsys, "project", "show", str(tmp_path / "p"), "--json").json["actions"][0]["action_caption"] == caption
    )


def test_an_empty_project_is_a_project(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_project(tmp_path / "p", msgspec.structs.replace(HUMANOID, project_id=0, active_joystick_table=None))
    assert "chosen by the board" in call(capsys, "project", "show", str(tmp_path / "p")).out
    save_project(tmp_path / "p", Project())
    assert len(call(capsys, "project", "show", str(tmp_path / "p")).out.splitlines()) == 3
