"""Projects from parts that call each other by object."""

from __future__ import annotations

import math
from typing import Any

import pytest

from servolink.errors import EncodeError, ProjectError
from servolink.project.build import build_project, extend_project
from servolink.project.model import Project
from servolink.protocol import (
    Action,
    AddMacroRequest,
    Button,
    Codec,
    JoystickTable,
    Macro,
    MacroCommand,
    ServoParameter,
    Step,
)

UP = Action.pose("Up", {1: 60, 2: -30}, seconds=0.5)
DOWN = Action.pose("Down", {1: 20, 2: 0}, seconds=0.25)
WAVE = Macro.of("Wave", UP, DOWN, loop=2)
HELLO = Macro.of("Hello", WAVE, 0.3, MacroCommand.of(UP, ratio=50, loop=3))
PAD = JoystickTable.of("Pad", Button.of(1, "hello", press=HELLO, up=WAVE, uninterruptible=True))


def test_a_pose() -> None:
    assert Action(0, "Up", (Step(1, 60, 50), Step(2, -30, 50))) == UP
    assert Action.pose("Now", {}, seconds=0, action_id=7) == Action(7, "Now")
    assert Action.pose("Long", {1: 0}, seconds=327.67).steps[0].interval == 0x7FFF
    assert Action.pose("", {1: 0}, seconds=0.285).steps[0].interval in {28, 29}


def test_a_project_has_all_that_its_parts_call() -> None:
    project = build_project(PAD)
    assert project.actions == (Action(1, "Up", UP.steps), Action(2, "Down", DOWN.steps))
    assert [macro.macro_id for macro in project.macros] == [1, 2]
    assert project.macros == (
        Macro(1, "Wave", (MacroCommand(1, 0, 100, 1, 500), MacroCommand(2, 0, 100, 1, 250)) * 2),
        Macro(
            2,
            "Hello",
            (MacroCommand(1, 2, 100, 1, 1500), MacroCommand(300, 1, 100, 1, 300), MacroCommand(1, 0, 50, 3, 3000)),
        ),
    )
    assert project.joystick_tables == (JoystickTable(1, "Pad", (Button(1, "hello", 2, 0, 1, 1),)),)
    assert project.active_joystick_table is None


def test_numbers_are_given_in_the_order_of_the_parts() -> None:
    assert [one.action_caption for one in build_project(DOWN, HELLO).actions] == ["Down", "Up"]
    assert build_project(DOWN, UP, WAVE, HELLO, PAD) == build_project(DOWN, PAD)
    assert build_project() == Project()


def test_numbers_that_are_given_are_kept_from_others() -> None:
    second = Action.pose("Second", {1: 1}, action_id=1)
    project = build_project(UP, Macro.of("Both", DOWN, second, macro_id=5), Macro.of("One", second), project_id=9)
    assert [(one.action_id, one.action_caption) for one in project.actions] == [(2, "Up"), (3, "Down"), (1, "Second")]
    assert [one.macro_id for one in project.macros] == [5, 1]
    assert [one.command_id for one in project.macros[0].commands] == [3, 1]
    assert project.project_id == 9


def test_the_same_without_a_number_is_one() -> None:
    again = Action.pose("Up", {1: 60, 2: -30}, seconds=0.5)
    assert build_project(UP, again, Macro.of("M", again)).actions == (Action(1, "Up", UP.steps),)
    other = Action.pose("Up", {1: 61, 2: -30}, seconds=0.5)
    assert len(build_project(UP, other).actions) == 2


def test_the_same_with_a_number_is_one() -> None:
    numbered = Macro.of("Numbered", UP, macro_id=5)
    project = build_project(numbered)
    assert extend_project(project, numbered, Macro.of("Twice", numbered, loop=2)).macros[0] == project.macros[0]


def test_times_that_are_known_or_were_given_are_kept() -> None:
    slow = Macro(1, "Slow", (MacroCommand(1, total_interval=9000), MacroCommand(1)))
    before = Project(actions=(Action(1, "Up", UP.steps),), macros=(slow,))
    assert extend_project(before, DOWN).macros == (slow,)
    assert [one.total_interval for one in build_project(*before.actions, slow).macros[0].commands] == [9000, 500]


def test_macros_that_differ_in_what_they_call_are_two() -> None:
    project = build_project(Macro.of("M", UP), Macro.of("M", DOWN))
    assert [one.commands[0].command_id for one in project.macros] == [1, 2]


def test_more_is_added_to_a_project() -> None:
    before = build_project(PAD, project_id=3)
    after = extend_project(before, WAVE, Macro.of("More", UP, Action.pose("New", {3: 1})))
    assert after.actions[:2] == before.actions
    assert [one.action_caption for one in after.actions] == ["Up", "Down", "New"]
    assert after.macros[:2] == before.macros
    assert [one.command_id for one in after.macros[2].commands] == [1, 3]
    assert after.project_id == 3
    assert extend_project(before) == before


def test_servos_get_captions() -> None:
    project = build_project(ServoParameter(1, 4, "x"), captions={1: "left arm", 2: "neck"})
    assert project.servo_parameters == (ServoParameter(1, 4, "left arm"), ServoParameter(2, 0, "neck"))
    assert extend_project(project, captions={2: "head"}).servo_parameters[1] == ServoParameter(2, 0, "head")


def test_a_table_is_made_the_active_one() -> None:
    second = JoystickTable.of("Second")
    assert build_project(PAD, second, active=second).active_joystick_table == 1
    project = extend_project(build_project(PAD), active=second)
    assert (project.active_joystick_table, len(project.joystick_tables)) == (2, 2)
    assert extend_project(project, UP).active_joystick_table == 2


def test_numbers_without_objects_are_left_alone() -> None:
    macro = Macro(2, "By hand", (MacroCommand(77), MacroCommand(UP.action_id, 1)))
    assert build_project(macro).macros == (macro,)


def test_two_with_one_number_are_refused() -> None:
    with pytest.raises(ProjectError, match="action 1 'A' and action 1 'B' have the same id"):
        build_project(Action.pose("A", {1: 1}, action_id=1), Action.pose("B", {1: 1}, action_id=1))
    with pytest.raises(ProjectError, match="action 1 'Up' and action 1 'B' have the same id"):
        extend_project(build_project(UP), Action.pose("B", {1: 1}, action_id=1))


@pytest.mark.parametrize("part", ["wave", 3, None, MacroCommand(1)])
def test_what_is_no_part_is_refused(part: Any) -> None:
    with pytest.raises(ProjectError, match="is not an action, a macro or a joystick table"):
        build_project(part)


@pytest.mark.parametrize("seconds", [-0.1, 327.68, math.nan, math.inf, True, "1", None, 10**400])
def test_times_that_are_not_possible_are_refused(seconds: Any) -> None:
    with pytest.raises(EncodeError, match=r"a time must be 0..327.67 s, not "):
        Action.pose("x", {1: 1}, seconds=seconds)


@pytest.mark.parametrize("pause", [-1, 2147483.648, math.nan])
def test_a_pause_that_is_not_possible_is_refused(pause: float) -> None:
    with pytest.raises(EncodeError, match="a time must be 0"):
        Macro.of("x", pause)


@pytest.mark.parametrize("part", ["wave", True, None, PAD])
def test_what_is_no_part_of_a_macro_is_refused(part: Any) -> None:
    with pytest.raises(EncodeError, match=r"an Action, a Macro or a pause in seconds, not ('wave'|True|None|Joy)"):
        Macro.of("x", part)


@pytest.mark.parametrize("started", ["wave", 3, UP])
def test_buttons_start_macros_only(started: Any) -> None:
    with pytest.raises(EncodeError, match=r"long_press: must be a Macro, as made by Macro\.of"):
        Button.of(1, long_press=started)


@pytest.mark.parametrize(
    ("part", "text"),
    [
        (Action.pose("Up", {1: 40000}), r"actions\[0\].steps\[0\].degree: 40000 is outside -32768..32767"),
        (Action.pose("Up", {1: 1.5}), "must be an integer, not 1.5"),
        (Action.pose("Up", {300: 1}), "300 is outside"),
        (Action.pose("x" * 33, {}), "33"),
        (Action.pose("\x1b", {}), "control characters"),
        (Action.pose(3, {}), "must be text, not 3"),  # type: ignore[arg-type]
        (Macro.of("M", MacroCommand.of(UP, ratio=0)), "ratio_percent: 0 is outside 1..100"),
        (JoystickTable.of("T", Button.of(-1)), "-1 is outside"),
    ],
)
def test_what_no_board_takes_is_refused_with_its_place(part: Any, text: str) -> None:
    with pytest.raises(ProjectError, match=text):
        build_project(part)


def test_what_was_wrong_before_does_not_matter() -> None:
    odd = Project(actions=(Action(9, "\x07"),))
    assert len(extend_project(odd, UP).actions) == 2
    with pytest.raises(ProjectError, match=r"actions\[1\]"):
        extend_project(odd, Action.pose("\x07", {1: 1}))


def test_a_macro_of_numbered_parts_can_be_sent_as_it_is() -> None:
    numbered = Macro.of("M", Action(3, "A"), macro_id=2)
    frame = Codec().encode(AddMacroRequest(numbered.macro_id, numbered.macro_caption, numbered.commands))
    assert Codec().decode_frame(frame) == AddMacroRequest(2, "M", (MacroCommand(3),))


def nested(depth: int) -> Macro:
    """Return a macro that calls one that calls one..., each twice."""
    macro = Macro.of("deepest", UP)
    for _ in range(depth):
        macro = Macro.of("M", macro, macro)
    return macro


def test_deep_macros_are_built_or_refused() -> None:
    assert len(build_project(nested(30)).macros) == 31
    with pytest.raises(ProjectError, match="nest deeper than 100"):
        build_project(nested(5000))
