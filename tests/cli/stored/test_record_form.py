"""Records have one form in JSON, that of project files, in every command; what is exported can be applied again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from servolink.cli.projects.apply import question
from servolink.project import Change, Memory, Plan, Project, ProjectFile, load_project, save_project
from servolink.protocol import ACTION, Action, Macro, MacroCommand
from servolink.virtual import VirtualBoard, save_state
from tests.cli.programs import call
from tests.project.projects import HUMANOID


@pytest.fixture
def form(tmp_path: Path) -> Any:
    """The project in the form of its file."""
    save_project(tmp_path / "robot", HUMANOID)
    return json.loads((tmp_path / "robot").read_text(encoding="utf-8"))


@pytest.fixture
def board(tmp_path: Path, form: Any, capsys: pytest.CaptureFixture[str]) -> str:
    """The address of a board that holds the project."""
    url = f"virtual://?servos=5&state={tmp_path / 'state'}"
    assert call(capsys, "apply", str(tmp_path / "robot"), "--yes", "--url", url).code == 0
    return url


@pytest.mark.parametrize(
    ("command", "field", "record_id"),
    [("actions", "actions", "1"), ("macros", "macros", "4"), ("tables", "joystick_tables", "7")],
)
def test_one_record(
    command: str, field: str, record_id: str, form: Any, board: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(capsys, command, record_id, "--json", "--url", board).json == form[field][0]


ACTIONS = [{"action_id": 1, "action_caption": "Raise left arm"}, {"action_id": 2, "action_caption": "Nod"}]
MACROS = [{"macro_id": 4, "macro_caption": "Wave left"}, {"macro_id": 5, "macro_caption": "Show"}]
TABLES = [{"table_id": 7, "table_caption": "Pad", "is_active": True}]


@pytest.mark.parametrize(
    ("command", "entries"),
    [("actions", {"actions": ACTIONS}), ("macros", {"macros": MACROS}), ("tables", {"joystick_tables": TABLES})],
)
def test_lists(command: str, entries: object, board: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, command, "--json", "--url", board).json == entries


def test_a_whole_project(form: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shown = call(capsys, "project", "show", str(tmp_path / "robot"), "--json").json
    del form["schema"], shown["stored_bytes"], shown["duration_seconds"]
    assert shown == form


def test_a_plan(form: Any, board: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_project(tmp_path / "empty", Project(77))
    plan = call(capsys, "plan", str(tmp_path / "empty"), "--json", "--url", board).json
    old = {change["what"]: change["old"] for change in plan["changes"]}
    assert old["action 1"] == form["actions"][0]
    assert old["macro 4"] == form["macros"][0]
    assert old["joystick table 7"] == form["joystick_tables"][0]
    assert old["servo parameter 1"] == form["servo_parameters"][0]


def test_what_is_exported_can_always_be_planned_and_applied(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    odd = VirtualBoard(2)
    odd.storage.put(ACTION, {3: b"\3\0\0\0" + b"\x1b[2J".ljust(32, b"\0") + b"\1\0\1\x0a\0\x14\0"})
    save_state(odd, tmp_path / "state")
    url, file = f"virtual://?servos=2&state={tmp_path / 'state'}", str(tmp_path / "odd")
    exported = call(capsys, "export", file, "--url", url)
    assert exported.code == 0
    assert "actions[0].action_caption" in exported.err
    assert ProjectFile.read(file).unchecked
    assert call(capsys, "plan", file, "--url", url).code == 0
    other = f"virtual://?servos=2&state={tmp_path / 'other'}"
    assert call(capsys, "plan", file, "--url", other).code == 1
    assert call(capsys, "apply", file, "--yes", "--url", other).code == 0
    assert call(capsys, "export", file, "--yes", "--url", other).code == 0
    assert load_project(file).actions[0].action_caption == "\x1b[2J"


def test_a_repaired_export_keeps_its_mark(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    odd = Project(actions=(Action(2, "\x07"), Action(1, "b")), macros=(Macro(3, "m", (MacroCommand(1),)),))
    save_project(tmp_path / "odd", Project(actions=odd.actions, macros=odd.macros), unchecked=True)
    assert call(capsys, "project", "check", str(tmp_path / "odd"), "--fix").code == 1
    assert ProjectFile.read(tmp_path / "odd").unchecked


@pytest.mark.parametrize("number", ["0", "-1", "2147483648"])
def test_an_id_is_a_positive_number(number: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--url", "virtual://", "actions", "--", number)
    assert (said.code, "must be an integer from 1 to 2147483647" in said.err) == (2, True)


def test_the_question_names_what_is_deleted() -> None:
    gone = [Change(f"action {number}", Action(number)) for number in range(1, 8)]
    plan = Plan((*gone, Change("project id", 3)), (), 0, 0, 0.0, Memory(None, None, 0, 0), is_unfinished=False)
    deleted = "action 1, action 2, action 3, action 4, action 5 and 2 more"
    assert question(plan) == f"write this to the board, and delete {deleted} from it?"
    assert question(replace(plan, changes=())) == "write this to the board?"
