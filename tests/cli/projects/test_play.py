"""`servolink project play`: who moves when."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from servolink.cli.projects import play
from servolink.cli.projects.play import chart
from servolink.cli.screen.output import text_width
from servolink.project import Project, save_project
from servolink.protocol import Action, Macro, MacroCommand, ServoParameter, Step
from servolink.virtual import DryMove, Timeline
from tests.cli.programs import call
from tests.cli.terminals import in_terminal
from tests.project.projects import HUMANOID

LONG = Macro(6, "Endless", (MacroCommand(1, loop=0x7FFF),))
ITSELF = Macro(7, "Itself", (MacroCommand(7, 2),))


@pytest.fixture
def file(tmp_path: Path) -> str:
    """A project to play from."""
    path = tmp_path / "robot"
    nothing = Action(9, "Nothing")
    project = msgspec.structs.replace(
        HUMANOID, actions=(*HUMANOID.actions, nothing), macros=(*HUMANOID.macros, LONG, ITSELF)
    )
    save_project(path, project)
    return str(path)


def test_the_chart(file: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "72")
    said = call(capsys, "project", "play", file, "Show")
    assert (said.code, said.err) == (0, "")
    assert (
        said.out
        == """\
macro 5 'Show' takes 2.6 s

servo                 0 s      0.5       1        1.5       2        2.5
    1  left shoulder  [60===============][60===============]
    3  L elbow        [-30==========]    [-30==========]
    5  neck           [10====]           [10===]                 [20==]

servo                 at the end
    1  left shoulder          60
    3  L elbow               -30
    5  neck                   20
"""
    )


def test_as_json(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    described = call(capsys, "project", "play", file, "macro:5", "--json").json
    assert {**described, "moves": None, "angles": None} == {
        "kind": "macro",
        "id": 5,
        "caption": "Show",
        "duration_seconds": 2.6,
        "is_whole": True,
        "moves": None,
        "angles": None,
    }
    assert described["moves"][-1] == {
        "servo_id": 5,
        "start_seconds": 2.3,
        "end_seconds": 2.6,
        "from_degree": 10,
        "target_degree": 20,
        "is_cut": False,
    }
    assert len(described["moves"]) == 7
    assert described["angles"] == [
        {"servo_id": 1, "degree": 60},
        {"servo_id": 2, "degree": 0},
        {"servo_id": 3, "degree": -30},
        {"servo_id": 4, "degree": 0},
        {"servo_id": 5, "degree": 20},
    ]


def test_on_a_terminal_the_servos_are_seen_to_move(file: str) -> None:
    said = in_terminal("project", "play", file, "Nod")
    assert said.code == 0
    assert "servo 5" in said.out  # a bar
    assert "servo 1" not in said.out
    assert "0.3 s" in said.out
    assert "action 2 'Nod' takes 0.3 s" in said.out


def test_on_a_terminal_nobody_needs_to_wait(file: str) -> None:
    said = in_terminal("project", "play", file, "Nod", "--fast")
    assert (said.code, "servo 5" in said.out) == (0, False)
    assert "[20=" in said.out


def test_what_moves_nothing(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "project", "play", file, "Nothing").out == "action 9 'Nothing' takes 0 s\nno servo moves\n"


def test_what_has_no_end_is_cut_off(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "project", "play", file, "Endless")
    assert said.code == 0
    assert "macro 6 'Endless' takes 600 s; the chart shows only the beginning" in said.out
    assert max(map(len, said.out.splitlines())) <= 100
    assert call(capsys, "project", "play", file, "Endless", "--json").json["is_whole"] is False


def test_what_cannot_be_played(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "project", "play", file, "Itself")
    assert (said.code, said.out) == (1, "")
    assert said.err.startswith("servolink: macro 7 'Itself': cannot be played")
    assert call(capsys, "project", "play", file, "nobody").code == 1


@pytest.mark.parametrize("source", ["tcp://127.0.0.1:1", "serial:///dev/ttyACM0", "usb://"])
def test_no_board_is_ever_moved(source: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "project", "play", source, "1")
    assert (said.code, said.out) == (2, "")
    assert "play reads a file" in said.err


def test_a_virtual_board_may_be_where_it_comes_from(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "project", "play", "virtual://", "Wave")
    assert (said.code, "there are no " in said.err) == (1, True)


def test_ids_that_are_there_twice_are_not_played(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_project(tmp_path / "p", Project(actions=(Action(1, "A"), Action(1, "B"))))
    said = call(capsys, "project", "play", str(tmp_path / "p"), "A")
    assert (said.code, "action 1 exists twice" in said.err) == (1, True)


def test_captions_are_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hostile = "\x1b[2J\u202e左"
    project = Project(
        servo_parameters=(ServoParameter(1, 0, hostile),), actions=(Action(1, hostile, (Step(1, 5, 9),)),)
    )
    save_project(tmp_path / "p", project, unchecked=True)
    said = call(capsys, "project", "play", str(tmp_path / "p"), "1")
    assert said.code == 0
    assert all(character == "\n" or character.isprintable() for character in said.out)


def drawn(seconds: float, *moves: DryMove, width: int = 48) -> list[str]:
    """Return a chart without its labels."""
    lines = chart(Timeline(seconds, moves, {}, is_whole=True), {}, width)
    return [line[7:] for line in lines]


def test_bars() -> None:
    assert drawn(
        4.0,
        DryMove(1, 0.0, 1.0, 0, 60),
        DryMove(1, 1.0, 1.5, 60, -120, is_cut=True),
        DryMove(1, 1.5, 1.5, 0, 9),
        DryMove(2, 0.5, 0.7, 0, 1000),
        DryMove(2, 2.0, 2.1, 0, 5),
        DryMove(2, 3.98, 4.0, 0, 5),
        DryMove(3, 0.0, 4.0, 0, 0),
    ) == [
        "  0 s       1         2         3         4",
        "  [60======][===>|",
        "       []             |                   |",
        "  [0=====================================]",
    ]


def test_bars_end_where_the_chart_does() -> None:
    _, *rows = drawn(2.0, DryMove(1, 1.0, 1e9, 0, 60), DryMove(2, 2.0, 1e9, 0, 60), DryMove(3, 1.0, 2.0, 0, 60))
    assert rows == [" " * 22 + "[60=================>", " " * 42 + "|", " " * 22 + "[60================]"]


def test_a_chart_of_no_time() -> None:
    axis, row = drawn(0.0, DryMove(1, 0.0, 0.0, 0, 60))
    assert axis.split() == ["0", "s"]
    assert row.strip() == "|"


@pytest.mark.parametrize("seconds", [0.01, 0.07, 0.99, 3.0, 59.9, 600.0])
@pytest.mark.parametrize("width", [1, 40, 80, 250])
def test_a_chart_fits(seconds: float, width: int) -> None:
    lines = chart(Timeline(seconds, (DryMove(254, 0.0, seconds, 0, 5),), {}, is_whole=True), {254: "左" * 10}, width)
    assert all(text_width(line) <= max(width, 49) for line in lines)
    assert "0 s" in lines[0]
    assert lines[1].endswith("]")


def test_a_chart_is_no_wider_than_anything_that_shows_it() -> None:
    assert 900 < max(map(len, drawn(1.0, DryMove(1, 0.0, 1.0, 0, 5), width=99_999))) < 1100


def test_ctrl_c_ends_the_show(file: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    async def interrupted(*_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(play, "is_terminal", lambda: True)
    monkeypatch.setattr(play, "_show", interrupted)
    said = call(capsys, "project", "play", file, "Nod")
    assert (said.code, said.out) == (130, "")
    assert said.err == "interrupted: only a virtual board was moved\n"
