"""Motions copied in one studio are added to the project of another robot."""

from __future__ import annotations

import json
from typing import Any

import pytest

from servolink.errors import ProjectError
from servolink.project.merge import CopiedMotions
from servolink.project.mirror import Mirror
from servolink.project.model import Project
from servolink.project.project_file import ProjectFile
from servolink.protocol import Action, Macro, MacroCommand, Step

NamedServo = CopiedMotions.NamedServo

UP = Action(1, "up", (Step(1, 90, 50), Step(2, -30, 100)))
DOWN = Action(4, "down", (Step(1, 0, 50),))
INNER = Macro(1, "Wave", (MacroCommand(1, 0, 100, 1, 1000), MacroCommand(300, 1), MacroCommand(4, 0, 50, 2)))
OUTER = Macro(2, "Show", (MacroCommand(1, 2, 100, 3),))
ROBOT = Project(actions=(UP, DOWN), macros=(INNER, OUTER))


def text_of(project: Project = ROBOT, **fields: Any) -> str:
    """Return what the studio puts into the clipboard."""
    form = ProjectFile(project).form()
    servos = [{"id": servo, "caption": f"servo {servo}", "part": ""} for servo in (1, 2)]
    records = {"actions": form["actions"], "macros": form["macros"]}
    return json.dumps({"kind": "servolink motions", "version": 1, "servos": servos, **records, **fields})


def images(**servos: int) -> dict[int, Mirror.ServoImage]:
    """Return the servo of this robot for servos of the other, as in `images(_1=5)`."""
    return {int(one[1:]): Mirror.ServoImage(ours, 1, 0, is_right=False) for one, ours in servos.items()}


def pasted(project: Project = ROBOT, *, factor: float = 1, before: Project | None = None, **servos: int) -> Project:
    after, left = CopiedMotions.parse(text_of(project)).pasted(before or Project(), images(**servos), factor)
    assert left == []
    return after


def test_a_macro_comes_with_all_it_runs_and_with_right_durations() -> None:
    after = pasted(_1=1, _2=2)
    assert [one.action_caption for one in after.actions] == ["up", "down"]
    inner, outer = after.macros
    up, down = (one.action_id for one in after.actions)
    assert [one.command_id for one in inner.commands] == [up, 300, down]
    assert [one.total_interval for one in inner.commands] == [1000, 300, 2000]
    assert (outer.commands[0].command_id, outer.commands[0].total_interval) == (inner.macro_id, 9900)


def test_servos_are_matched_by_caption_then_by_part_then_by_id() -> None:
    rows = [(1, "R  Arm", ""), (2, "twin", ""), (3, "", "knee_r"), (4, "", ""), (5, "lost", ""), (6, "twin", "")]
    theirs = [{"id": servo, "caption": caption, "part": part} for servo, caption, part in rows]
    ours = [(9, "r arm", ""), (8, "twin", ""), (7, "x", "knee_r"), (4, "", ""), (5, "", "")]
    copied = CopiedMotions.parse(text_of(servos=theirs))
    found = copied.pairs([NamedServo(*one) for one in ours])
    assert found == {1: 9, 3: 7, 4: 4}


def test_steps_of_servos_without_a_partner_are_left_out_with_all_that_needs_them() -> None:
    copied = CopiedMotions.parse(text_of())
    half, left = copied.pasted(Project(), images(_2=5), 1)
    assert ([one.steps for one in half.actions], left) == ([(Step(5, -30, 100),)], ["down"])
    assert [one.type for one in half.macros[0].commands] == [0, 1]
    none, left = copied.pasted(Project(), {}, 1)
    assert (none.actions, left) == ((), ["up", "down"])
    assert [one.command_id for one in none.macros[0].commands] == [300]


def test_of_two_servos_with_the_same_partner_the_first_counts() -> None:
    assert pasted(_1=5, _2=5).actions[0].steps == (Step(5, 90, 50),)


def test_motions_are_mirrored_and_retimed() -> None:
    mirrored = {1: Mirror.ServoImage(2, -1, 0, is_right=False), 2: Mirror.ServoImage(1, -1, 0.4, is_right=True)}
    after, _ = CopiedMotions.parse(text_of()).pasted(Project(), mirrored, 1.53)
    assert after.actions[0].steps == (Step(1, 30, 153), Step(2, -90, 76))
    assert after.macros[0].commands[1].command_id == 459


def test_an_action_that_is_there_is_used_and_another_of_its_name_gets_a_number() -> None:
    again = pasted(before=ROBOT, _1=1, _2=2)
    assert again.actions == ROBOT.actions
    assert [one.macro_caption for one in again.macros] == ["Wave", "Show", "Wave 2", "Show 2"]
    slower = pasted(before=ROBOT, factor=2, _1=1, _2=2)
    assert [one.action_caption for one in slower.actions] == ["up", "down", "up 2", "down 2"]


@pytest.mark.parametrize(("caption", "numbered"), [("x" * 32, f"{'x' * 30} 2"), ("手" * 10 + "xx", f"{'手' * 10} 2")])
def test_a_number_behind_a_long_caption_takes_the_place_of_its_end(caption: str, numbered: str) -> None:
    long = Project(actions=(Action(1, caption, UP.steps),))
    assert [one.action_caption for one in pasted(long, before=long, _1=1).actions] == [caption, numbered]


def test_a_time_too_long_for_a_board_is_refused() -> None:
    with pytest.raises(ProjectError, match="too long"):
        pasted(factor=400, _1=1, _2=2)


def test_macros_that_run_themselves_are_left_out() -> None:
    endless = Project(actions=(UP,), macros=(Macro(7, "Loop", (MacroCommand(7, 2),)), Macro(8, "Good", ())))
    assert [one.macro_caption for one in pasted(endless, _1=1, _2=2).macros] == ["Good"]


@pytest.mark.parametrize(
    "fields",
    [
        {"kind": "other"},
        {"version": 2},
        {"servos": "x"},
        {"servos": [{"id": 256, "caption": "", "part": ""}]},
        {"actions": None},
        {"actions": [{"action_id": 1, "steps": [{"servo_id": 1, "degree": 10**9, "interval_ms": 10}]}]},
        {"actions": [{"action_id": 1, "steps": [{"servo_id": 1.5, "degree": 1, "interval_ms": 10}]}]},
        {"actions": [{"action_id": 1, "action_caption": "\x1b[31m"}]},
        {"macros": [{"macro_id": 1, "commands": [{"type": "constructor", "constructor": 1}]}]},
    ],
)
def test_a_text_with_a_wrong_value_is_no_copy(fields: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"."):
        CopiedMotions.parse(text_of(**fields))


@pytest.mark.parametrize("text", ["", "null", "[]", "{", "<b>", "{" * 100_000])
def test_any_other_text_is_no_copy(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        CopiedMotions.parse(text)
