"""Repairs: of what has one right answer, and of nothing else.

Module: servolink.project.naming.
"""

from __future__ import annotations

from hypothesis import given

from servolink.project.fix import fix_project
from servolink.project.model import Project
from servolink.project.validate import validate_project
from servolink.protocol import Action, Button, JoystickTable, Macro, MacroCommand, ServoParameter, Step
from tests.project.drawn import projects, said_projects

STEP, OTHER = Step(1, 30, 100), Step(1, 0, 100)
WAVE = Action(1, "wave", (STEP,))


def test_times_of_macros_are_put_right() -> None:
    macros = (
        Macro(1, "a", (MacroCommand(1), MacroCommand(2, 2, 50, 1, 77), MacroCommand(5, 1, total_interval=5))),
        Macro(2, "b", (MacroCommand(1, 0, 100, 3, 9000),)),
    )
    project, done = fix_project(Project(actions=(WAVE,), macros=macros))
    assert [[command.total_interval for command in macro.commands] for macro in project.macros] == [
        [1000, 6000, 5],
        [3000],
    ]
    assert done == [
        "macro 1 'a', command 1: total_interval_ms was 0, is now 1000",
        "macro 1 'a', command 2: total_interval_ms was 77, is now 6000",
        "macro 2 'b', command 1: total_interval_ms was 9000, is now 3000",
    ]


def test_what_is_there_twice_with_the_same_values_is_left_out() -> None:
    table = JoystickTable(1, "pad", (Button(4), Button(4), Button(4)))
    project, done = fix_project(
        Project(
            0, (ServoParameter(3, 1), ServoParameter(3, 1)), (WAVE, Action(2, "b", (STEP, STEP)), WAVE), (), (table,)
        )
    )
    assert project == Project(
        0, (ServoParameter(3, 1),), (WAVE, Action(2, "b", (STEP,))), (), (JoystickTable(1, "pad", (Button(4),)),)
    )
    assert done == [
        "servo 3: removed a copy with the same values",
        "action 1 'wave': removed a copy with the same values",
        "action 2 'b', servo 1: removed a copy with the same values",
        *["joystick table 1 'pad', button 4: removed a copy with the same values"] * 2,
    ]


def test_what_is_there_twice_with_other_values_is_left_to_its_author() -> None:
    project = Project(
        0,
        (ServoParameter(3, 1), ServoParameter(3, 2)),
        (WAVE, Action(1, "other"), WAVE, Action(2, "", (STEP, OTHER, STEP))),
        (Macro(1, "", (MacroCommand(9, 1),)), Macro(1)),
        (JoystickTable(1), JoystickTable(2)),
        3,
    )
    assert fix_project(project) == (project, [])


def test_records_are_put_in_order_and_their_steps_are_not() -> None:
    steps = (Step(2, 0, 0), Step(1, 0, 0))
    project, done = fix_project(Project(0, (ServoParameter(2), ServoParameter(1)), (Action(2, "", steps), Action(1))))
    assert project == Project(0, (ServoParameter(1), ServoParameter(2)), (Action(1), Action(2, "", steps)))
    assert done == ["servo_parameters: sorted by id", "actions: sorted by id"]


def test_an_active_table_that_is_not_there_is_the_only_one_or_none() -> None:
    one = Project(joystick_tables=(JoystickTable(4),), active_joystick_table=9)
    assert fix_project(one)[0].active_joystick_table == 4
    assert fix_project(one)[1] == ["active_joystick_table: was 9, which does not exist; is now 4, the only table"]
    project, done = fix_project(Project(active_joystick_table=9))
    assert project == Project()
    assert done == ["active_joystick_table: was 9, which does not exist; is now null, because there is no table"]


def test_a_sound_project_is_left_alone() -> None:
    macro = Macro(1, "m", (MacroCommand(1, total_interval=1000),))
    project = Project(
        7, (ServoParameter(1, 2, "a"),), (WAVE,), (macro,), (JoystickTable(1, "", (Button(1, "", 1),)),), 1
    )
    assert fix_project(project) == (project, [])


def test_records_that_become_the_same_are_not_kept_twice() -> None:
    once, twice = (JoystickTable(1, "pad", (Button(4),) * times) for times in (1, 2))
    assert fix_project(Project(joystick_tables=(once, twice)))[0] == Project(joystick_tables=(once,))


@given(projects | said_projects())
def test_all_that_is_called_fixable_is_fixed_at_once_and_said(project: Project) -> None:
    repaired, done = fix_project(project)
    assert not [problem for problem in validate_project(repaired) if problem.fixable]
    assert fix_project(repaired) == (repaired, [])
    assert bool(done) == (repaired != project)
    before, after = (
        {problem.text for problem in validate_project(one) if not problem.fixable} for one in (project, repaired)
    )
    assert len(after) <= len(before)
