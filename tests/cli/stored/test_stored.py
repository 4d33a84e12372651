"""`servolink action`, `macro` and `table`: one stored record is added, changed, renamed, deleted and run.

Modules: servolink.cli.stored.edit_records, servolink.cli.stored.given, servolink.cli.stored.record_tables,
servolink.cli.stored.show_records, servolink.cli.stored.verbs.
"""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from servolink.client import Board
from servolink.project import UNFINISHED, BackupStore, Project, save_project
from servolink.protocol import (
    Action,
    Button,
    JoystickTable,
    Macro,
    MacroCommand,
    MacroCommandType,
    ServoParameter,
    Step,
)
from servolink.virtual import BoardKind, VirtualBoard
from tests.cli.robot import Robot
from tests.cli.terminals import in_terminal

BOW = Action(1, "Bow", (Step(1, 30, 50), Step(2, -30, 10)))
NOD = Action(2, "Nod", (Step(1, 10, 5),))
GREET = Macro(1, "Greet", (MacroCommand(1, total_interval=500),))
PAD = JoystickTable(1, "Pad", (Button(3, "greet", button_press_macro=1),))
STORED = Project(77, (), (BOW, NOD), (GREET,), (PAD,), 1)


@pytest.fixture(autouse=True)
def _own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    monkeypatch.chdir(tmp_path)


@pytest.fixture(name="robot")
def _robot(robot: Robot) -> Robot:
    robot.ask(lambda board: board.apply_project(STORED, backup=False))
    return robot


def stored(robot: Robot) -> Project:
    return robot.ask(lambda board: board.export_project())


def test_a_caption_that_is_used_twice_is_said(robot: Robot) -> None:
    said = robot("action", "add", "Bow", "--pose", "1=30")
    assert (said.code, said.err) == (
        0,
        "servolink: action 1 'Bow' and action 3 'Bow' share a caption; from now on, give ids\n",
    )
    assert robot("action", "set", "3", "--seconds", "2").err == "", "it did so before"
    assert "action 3 'bow' share" not in robot("action", "rename", "3", "bow").err
    assert robot("servo", "rename", "1", "hip").err == ""
    said = robot("servo", "rename", "2", "hip")
    assert (
        said.err
        == "servolink: servo parameter 1 'hip' and servo parameter 2 'hip' share a caption; from now on, give ids\n"
    )


def test_a_pose_of_all_servos_names_each(robot: Robot) -> None:
    assert robot("action", "add", "Home", "--pose", "all=0", "--seconds", "0.5").code == 0
    home = Action(3, "Home", (Step(1, 0, 50), Step(2, 0, 50), Step(3, 0, 50)))
    assert stored(robot).actions == (BOW, NOD, home)
    assert robot("action", "set", "Nod", "--pose", "all=7").code == 0
    assert [step.servo_id for step in stored(robot).actions[1].steps] == [1, 2, 3]
    twice = robot("action", "add", "Bend", "--pose", "1=3,all=5")
    assert (twice.code, "a servo is given twice" in twice.err) == (1, True)


def test_servos_that_the_board_does_not_have_are_named(robot: Robot) -> None:
    """They may be connected later, so the action is stored and run all the same."""
    warning = "servolink: the board has no servo 9 now: its steps move nothing\n"
    added = robot("action", "add", "Far", "--pose", "9=3,1=4")
    assert (added.code, added.err) == (0, warning)
    assert robot("action", "rename", "Far", "Farther").err == ""
    assert robot("action", "set", "Farther", "--pose", "8=3,9=3").err == (
        "servolink: the board has no servos 8, 9 now: their steps move nothing\n"
    )
    assert robot("action", "set", "Farther", "--pose", "9=3,1=4").err == warning
    started = robot("run", "action", "Farther")
    assert (started.code, started.err) == (0, warning)
    assert started.out == "action 3 'Farther' was started; it takes 1 s and moves servo 1\n"
    assert robot("run", "action", "Farther", "--json").json["servo_ids"] == [1]


def test_an_action_is_added_renamed_shown_and_deleted(robot: Robot) -> None:
    said = robot("action", "add", "Wave", "--pose", "1=30,2=-10", "--seconds", "0.5")
    assert (said.code, said.err) == (0, "")
    assert said.out.startswith("+ action 3 'Wave': 2 steps, 0.5 s\ndone, and verified")
    assert robot("action", "rename", "3", "Hello").out.startswith("~ action 3 'Hello'\n    caption 'Wave' -> 'Hello'\n")
    hello = Action(3, "Hello", (Step(1, 30, 50), Step(2, -10, 50)))
    assert stored(robot) == Project(77, (), (BOW, NOD, hello), (GREET,), (PAD,), 1)
    assert robot("action", "show", "3", "--json").json["steps"][1] == {"servo_id": 2, "degree": -10, "interval_ms": 500}
    assert robot("action", "delete", "3", "--yes").out.startswith("- action 3 'Hello'")
    assert stored(robot) == STORED
    backups = [BackupStore().load(backup.path) for backup in BackupStore().backups()]
    assert len(backups) == 3
    assert backups[2].actions == (BOW, NOD, hello), "what a change replaces is kept"
    assert robot("rollback", "--yes").code == 0
    assert stored(robot).actions == (BOW, NOD, hello)


def test_records_and_servos_are_named_by_caption(robot: Robot) -> None:
    robot.ask(lambda board: board.add_servo_parameters([ServoParameter(1, 0, "hip")]))
    assert robot("action", "add", "Wave", "--pose", "hip=30,2=-10").code == 0
    assert stored(robot).actions[2].steps == (Step(1, 30, 100), Step(2, -10, 100))
    assert robot("action", "set", "wave", "--pose", "HIP=5", "--seconds", "0.5").code == 0
    assert robot("action", "rename", "Wave", "Hello").code == 0
    assert stored(robot).actions[2] == Action(3, "Hello", (Step(1, 5, 50),))
    unknown = robot("action", "set", "Hello", "--pose", "hop=5")
    assert (unknown.code, unknown.err) == (1, "servolink: there is no servo 'hop'; did you mean servo 1 'hip'?\n")
    twice = robot("action", "set", "Hello", "--pose", "hip=5,1=5")
    assert (twice.code, twice.err) == (1, "servolink: a servo is given twice; nothing was changed on the board\n")
    assert robot("table", "activate", "Pad").out == "joystick table 1 'Pad' is active\n"
    assert robot("action", "delete", "Hello", "--yes").code == 0
    assert stored(robot).actions == (BOW, NOD)


def test_an_action_with_a_number_for_a_caption_is_said_to_need_the_prefix(robot: Robot) -> None:
    assert "the caption '3' is written name:3\n" in robot("action", "rename", "Bow", "3").err
    assert robot("action", "show", "name:3").code == 0
    assert robot("action", "rename", "name:3", "all").err == ""


def test_lists_are_those_of_the_short_forms(robot: Robot) -> None:
    for noun in ("action", "macro", "table"):
        assert robot(noun, "list").out == robot(f"{noun}s").out
        assert robot(noun, "list", "--json").json == robot(f"{noun}s", "--json").json
        assert robot(noun, "show", "1").out == robot(f"{noun}s", "1").out
        assert robot(noun, "list", "1").code == 2


def test_an_action_is_changed_and_macros_last_as_long_as_it(robot: Robot) -> None:
    assert robot("action", "set", "1", "--seconds", "2").code == 0
    after = stored(robot)
    assert after.actions[0].steps == (Step(1, 30, 200), Step(2, -30, 200))
    assert after.macros[0].commands[0].total_interval == 2000
    assert robot("action", "set", "1", "--pose", "3=5").code == 0
    assert stored(robot).actions[0].steps == (Step(3, 5, 200),)
    assert robot("action", "set", "1", '{"steps": []}').code == 0
    assert stored(robot).actions[0] == Action(1, "Bow")


def test_a_wrong_duration_that_was_there_stays(robot: Robot) -> None:
    wrong = Macro(2, "Odd", (MacroCommand(1, total_interval=7),))
    robot.ask(lambda board: board.add_macro(wrong))
    assert robot("action", "set", "1", "--seconds", "2").code == 0
    assert stored(robot).macros[1] == wrong


def test_macros_and_tables_by_options(robot: Robot) -> None:
    said = robot("macro", "add", "Dance", "--play", "action:Bow,wait:0.5,macro:greetx3@50", "--id", "9")
    assert (said.code, said.err) == (0, "")
    dance = Macro(
        9,
        "Dance",
        (MacroCommand(1, 0, 100, 1, 500), MacroCommand(500, 1, 100, 1, 500), MacroCommand(1, 2, 50, 3, 3000)),
    )
    assert stored(robot).macros == (GREET, dance)
    assert robot("macro", "set", "9", "--play", "wait:1").code == 0
    assert stored(robot).macros[1].commands == (MacroCommand(1000, 1, 100, 1, 1000),)
    assert robot("table", "add", "Left", "--press", "7=Dance", "--up", "7=1", "--long-press", "8=1").code == 0
    left = JoystickTable(2, "Left", (Button(7, "", 9, 0, 1), Button(8, "", 0, 1)))
    assert stored(robot).joystick_tables == (PAD, left)
    assert robot("table", "set", "1", "--up", "3=9").code == 0
    assert stored(robot).joystick_tables[0].buttons == (Button(3, "greet", 1, 0, 9),)
    assert robot("table", "activate", "2").out == "joystick table 2 'Left' is active\n"
    assert robot("table", "activate", "1", "--json").json == {"active_joystick_table": 1}
    assert robot("table", "delete", "1", "2", "--yes").code == 0
    assert stored(robot).joystick_tables == ()


def test_a_part_of_a_macro_is_a_caption_of_either_type(robot: Robot) -> None:
    robot.ask(lambda board: board.add_action(Action(5, "3", ())))
    assert robot("macro", "add", "Dance", "--play", "bow,Greetx3@50,wait:0.5,name:3").code == 0
    commands = stored(robot).macros[1].commands
    assert [(each.type, each.command_id, each.loop, each.ratio) for each in commands] == [
        (MacroCommandType.ACTION, 1, 1, 100),
        (MacroCommandType.MACRO, 1, 3, 50),
        (MacroCommandType.DELAY, 500, 1, 100),
        (MacroCommandType.ACTION, 5, 1, 100),
    ]
    assert robot("macro", "rename", "Dance", "Nod").code == 0
    said = robot("macro", "add", "Both", "--play", "Bow,Nod")
    why = "'Nod' may be action 2 'Nod' or macro 2 'Nod'; give type and id, as in action:2; nothing was changed on the"
    assert (said.code, said.err) == (1, f"servolink: {why} board\n")
    assert robot("macro", "add", "Both", "--play", "Bow,macro:Nod").code == 0


def test_records_as_json(robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = '{"action_caption": "Lift", "steps": [{"servo_id": 1, "degree": 5, "interval_ms": 50}]}'
    (tmp_path / "lift.json").write_text(text, encoding="utf-8")
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.replace("Lift", "Down").encode())))
    for given in ("@lift.json", "-", text.replace("Lift", "Up")):
        assert robot("action", "add", given).code == 0
    steps = (Step(1, 5, 5),)
    assert stored(robot).actions[2:] == (Action(3, "Lift", steps), Action(4, "Down", steps), Action(5, "Up", steps))
    same = robot("action", "set", "5", text.replace("Lift", "Up"), "--json").json
    assert same["changed"] is False


def test_several_steps_for_one_servo_are_named(robot: Robot) -> None:
    step = {"servo_id": 1, "degree": 5, "interval_ms": 50}
    text = json.dumps({"action_caption": "Lift", "steps": [step, {**step, "servo_id": 2}, {**step, "degree": 9}]})
    said = robot("action", "add", text)
    assert said.code == 0
    assert said.err.startswith("servolink: action 3 'Lift' has several steps for servo 1; boards differ in the step")
    assert "several steps" not in robot("action", "rename", "3", "Raise").err


def test_records_of_a_file_bring_along_what_they_run(robot: Robot, tmp_path: Path) -> None:
    spin = Action(1, "Spin", (Step(3, 90, 100),))
    file = Project(
        5, (), (spin, Action(8, "Idle")), (Macro(1, "Twirl", (MacroCommand(1, total_interval=1000),)),), (), None
    )
    save_project(tmp_path / "other.json", file)
    assert robot("macro", "add", "--from", "other.json", "Twirl").code == 0
    after = stored(robot)
    assert [one.action_caption for one in after.actions] == ["Bow", "Nod", "Spin"], "and nothing else"
    assert after.macros[1] == Macro(2, "Twirl", (MacroCommand(3, total_interval=1000),))
    assert (after.project_id, after.active_joystick_table) == (77, 1)
    assert "nothing to change" in robot("macro", "add", "--from", "other.json", "Twirl").out
    assert robot("action", "set", "2", "Spin", "--from", "other.json").code == 0
    assert stored(robot).actions[1] == Action(2, "Spin", spin.steps)
    said = robot("macro", "set", "1", "Twirl", "--from", "other.json")
    assert said.code == 1
    assert "macro 1 'Twirl' of the file runs action 1 'Spin', missing or different on the board" in said.err
    assert stored(robot).macros[0] == GREET


@pytest.mark.parametrize(
    ("command", "why"),
    [
        ("action show Bog", "the board has no action 'Bog'; did you mean action 1 'Bow'?"),
        ("action delete bog --yes", "nothing was changed on the board; did you mean action 1 'Bow'?"),
        ("action show 9", "the board has no action 9"),
        (
            "action set 9 --seconds 1",
            "has no action 9; nothing was changed on the board; there is action 1 'Bow' and action 2",
        ),
        ("action rename 9 x", "the board has no action 9"),
        ("action delete 2 9 --yes", "the board has no action 9"),
        ("action delete 1 --yes", "macro 1 'Greet' runs action 1 'Bow'; change or delete macro 1 first"),
        (
            "macro delete 1 --yes",
            "joystick table 1 'Pad' runs macro 1 'Greet'; change or delete joystick table 1 first",
        ),
        (
            "action add Wave --pose 1=3 --id 1",
            "action 1 'Bow' exists; use `set` to change the record, or leave out the id",
        ),
        ("macro add Dance --play action:7", "macro 'Dance' runs action 7, not on the board; add the action first"),
        ("macro set 1 --play macro:1", "runs itself"),
        ("action rename 1 123456789012345678901234567890123", "actions[0].action_caption: "),
        ('action set 1 {"action_id":4}', "the JSON has the id 4, not 1"),
        ('action add {"steps":3}', "steps: must be a list, not 3"),
        (
            'action add {"action_caption":"Up","steps":[{"servo_id":1,"degree":5,"interval_ms":400000}]}',
            "steps[0].interval_ms: 400000 is outside 0..327670",
        ),
        ('action add {"colour":3}', "colour"),
        ("action add {", "the record is not JSON"),
        ("action add @missing", "missing cannot be read: No such file"),
        ("action add Wave --from missing", "missing: cannot be read"),
        ("action add Wave --pose 1=3,1=4", "a servo is given twice"),
        ("macro add Dance --play action:Jump", "the board has no action 'Jump'"),
        (
            "macro add Dance --play Nodd",
            "the board has no action or macro 'Nodd'; nothing was changed on the board; did",
        ),
        ("table set 1 --press 3=Jump", "the board has no macro 'Jump'"),
        ("table activate 9", "the board has no joystick table 9"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(command: str, why: str, robot: Robot) -> None:
    said = robot(*command.split())
    assert (said.code, said.out) == (1, "")
    assert why in said.err
    assert stored(robot) == STORED
    assert not BackupStore().backups()


@pytest.mark.parametrize(
    ("command", "why"),
    [
        ("action add Wave", "say what it does: --pose, JSON, or --from FILE"),
        ("action add Wave --seconds 3", "say what it does: --pose"),
        ("action set 1", "say what it does: --pose"),
        ("action set 1 {} --seconds 3", "--seconds and JSON are both given; choose one"),
        ("action add Wave --pose 1", "argument --pose: '1' is not of the form SERVO=ANGLE"),
        ("action add Wave --pose 1=3 --seconds 400", "must be from 0 to 327.67 seconds, not '400'"),
        ("action add Wave --pose 1=3 --from x", "--pose and --from are both given"),
        ("action add Wave --id 3 --from x", "--id and --from are both given"),
        ("action set 1 --from x", "say which record of the file"),
        ("macro add Dance --play jump:3", "'jump:3' must be CAPTION, action:NAME, macro:NAME or wait:SECONDS"),
        ("macro add Dance --play 3", "'3' must say of what it is the id, as in action:3 or macro:3"),
        ("macro add Dance --play action:1@200", "must be an integer from 1 to 100, not '200'"),
        ("macro add Dance --play wait:1.2.3", "must be from 0 to 2.14748e+06 seconds"),
        ("table add Pad --press 7", "argument --press: '7' must be BUTTON=MACRO, such as 7=1"),
        ("table run 1", "there is no command 'run'"),
        ("action delete 2", "no terminal for the question; --yes continues without asking"),
        ("action delete 2 --json", "--json needs --yes"),
    ],
)
def test_wrong_usage(command: str, why: str, robot: Robot) -> None:
    said = robot(*command.split())
    assert (said.code, said.out) == (2, "")
    assert why in said.err


def test_json_names_the_backup_and_the_change(robot: Robot) -> None:
    said = robot("action", "add", "Wave", "--pose", "1=30", "--json").json
    assert said["changed"] is True
    assert Path(said["backup"]).is_file()
    [change] = said["plan"]["changes"]
    assert (change["what"], change["change"], change["new"]["action_caption"]) == ("action 3", "added", "Wave")


def test_nothing_is_changed_on_an_unfinished_import(robot: Robot) -> None:
    robot.ask(lambda board: board.write_project_id(UNFINISHED[5]))
    said = robot("action", "rename", "1", "x")
    assert said.code == 1
    assert said.err == (
        "servolink: this board holds an unfinished import: `servolink apply FILE` finishes it, `servolink rollback` "
        "undoes it; nothing was changed on the board\n"
    )


@pytest.mark.parametrize("on_duplicate", ["append", "reject", "replace"])
def test_boards_that_treat_a_stored_id_otherwise_lose_nothing(on_duplicate: Any, robot: Robot) -> None:
    robot.board = VirtualBoard(3, kind=BoardKind(on_duplicate=on_duplicate))
    robot.ask(lambda board: board.apply_project(STORED, backup=False))
    assert robot("action", "rename", "1", "Hello").code == 0
    assert [one.action_caption for one in stored(robot).actions] == ["Hello", "Nod"]


def test_a_change_by_another_program_is_not_undone(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = Board.plan_project

    async def disturbed(self: Board, *arguments: Any, **options: Any) -> Any:
        await self.add_action(Action(5, "Theirs"))
        return await plan(self, *arguments, **options)

    monkeypatch.setattr(Board, "plan_project", disturbed)
    said = robot("action", "rename", "1", "x")
    assert said.code == 1
    assert "another program is changing the board; nothing was changed on the board; try again" in said.err
    assert [one.action_caption for one in stored(robot).actions] == ["Bow", "Nod", "Theirs"]


def test_stored_records_are_run(robot: Robot) -> None:
    assert robot("action", "run", "2").out == "action 2 'Nod' was started; it takes 0.05 s and moves servo 1\n"
    assert robot("macro", "run", "greet", "--wait").out.startswith("macro 1 'Greet' is over: servos 1, 2 are at rest")
    assert robot("action", "run", "1", "--limit", "0", "5").code == 1


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
@pytest.mark.parametrize(("typed", "code"), [("y\n", 0), ("n\n", 1)])
def test_a_terminal_is_asked_before_something_is_deleted(typed: str, code: int, tmp_path: Path) -> None:
    address = f"virtual://?state={tmp_path / 'state'}"
    assert in_terminal("--url", address, "action", "add", "Wave", "--pose", "1=3").code == 0
    said = in_terminal("--url", address, "action", "delete", "1", typed=typed)
    assert said.code == code
    assert "write this to the board, and delete action 1 from it? [y/N]" in said.out
    left = in_terminal("--url", address, "action", "list").out
    assert ("Wave" in left) == bool(code)


@pytest.mark.parametrize(("verb", "default"), [("add", "1"), ("set", "as before")])
def test_the_help_says_how_long_an_action_takes_unless_that_is_given(verb: str, default: str, robot: Robot) -> None:
    told = " ".join(robot("action", verb, "--help").out.split())
    assert f"--seconds N duration in steps of 0.01 s ({default})" in told
