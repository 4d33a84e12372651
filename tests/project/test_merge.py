"""Two projects in one."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import ProjectError
from servolink.project.merge import merge_projects
from servolink.project.model import Project
from servolink.protocol import (
    ACTION,
    MACRO,
    TABLE,
    Action,
    Button,
    JoystickTable,
    Macro,
    MacroCommand,
    ServoParameter,
    Step,
)
from tests.project.projects import HUMANOID, NOD, PAD, RAISE, SHOW, WAVE


def test_the_same_twice_is_the_same() -> None:
    assert merge_projects(HUMANOID, HUMANOID) == (HUMANOID, [])
    assert merge_projects(HUMANOID, Project()) == (HUMANOID, [])
    assert merge_projects(Project(), HUMANOID)[0] == HUMANOID


def test_what_has_another_id_is_added_under_its_own() -> None:
    bow = Action(9, "Bow", (Step(1, 5, 5),))
    project, said = merge_projects(HUMANOID, Project(actions=(bow,)))
    assert project == msgspec.structs.replace(HUMANOID, actions=(RAISE, NOD, bow))
    assert said == ["action 9 'Bow' added"]


def test_what_means_something_else_gets_a_new_id_and_its_callers_follow() -> None:
    bow = Action(1, "Bow", (Step(1, 5, 5),))
    greet = Macro(4, "Greet", (MacroCommand(1), MacroCommand(1, 1), MacroCommand(2)))
    twice = Macro(6, "Twice", (MacroCommand(4, 2, loop=2),))
    other = Project(
        actions=(bow, NOD),
        macros=(greet, twice),
        joystick_tables=(JoystickTable(7, "Other", (Button(1, "", 6, 4, 0),)),),
        active_joystick_table=7,
    )
    project, said = merge_projects(HUMANOID, other)
    assert project.actions == (RAISE, NOD, Action(3, "Bow", bow.steps))
    assert project.macros == (
        WAVE,
        SHOW,
        Macro(1, "Greet", (MacroCommand(3), MacroCommand(1, 1), MacroCommand(2))),
        Macro(6, "Twice", (MacroCommand(1, 2, loop=2),)),
    )
    assert project.joystick_tables == (PAD, JoystickTable(1, "Other", (Button(1, "", 6, 1, 0),)))
    assert project.active_joystick_table == 7
    assert said == [
        "action 1 'Bow' added as 3",
        "macro 4 'Greet' added as 1",
        "macro 6 'Twice' added",
        "joystick table 7 'Other' added as 1",
        "joystick table 7 stays active",
    ]


def test_the_active_table_follows_its_new_id() -> None:
    one = Project(joystick_tables=(JoystickTable(7, "One"),))
    other = Project(joystick_tables=(JoystickTable(7, "Other"),), active_joystick_table=7)
    project, _ = merge_projects(one, other)
    assert project.active_joystick_table == 1
    assert TABLE.by_id(project)[1].table_caption == "Other"


def test_a_macro_that_calls_what_got_a_new_id_is_another_macro() -> None:
    other = msgspec.structs.replace(HUMANOID, actions=(Action(1, "Raise left arm", (Step(1, 61, 50),)), NOD))
    project, _ = merge_projects(HUMANOID, other)
    wave, show = project.macros[2:]
    assert wave.commands[0].command_id == 3
    assert show.commands[0].command_id == wave.macro_id
    assert project.joystick_tables[1].buttons[0] == Button(1, "wave", wave.macro_id, 0, show.macro_id)


def test_callers_may_come_before_what_they_call() -> None:
    caller = Macro(1, "Caller", (MacroCommand(2, 2),))
    one, other = (Project(macros=(caller, Macro(2, "Waits", (MacroCommand(delay, 1),)))) for delay in (5, 6))
    project, _ = merge_projects(one, other)
    assert project.macros[2:] == (
        Macro(4, "Caller", (MacroCommand(3, 2),)),
        Macro(3, "Waits", (MacroCommand(6, 1),)),
    )


def test_macros_that_never_end_can_be_merged() -> None:
    one = Project(macros=tuple(Macro(at, "XY"[at % 2], (MacroCommand(at % 4 + 1, 2),)) for at in (1, 2, 3, 4)))
    other = Project(macros=(Macro(1, "Y", (MacroCommand(2, 2),)), Macro(2, "X", (MacroCommand(1, 2),))))
    project, _ = merge_projects(one, other)
    assert project.macros[:4] == one.macros
    first, second = project.macros[4:]
    assert (first.commands[0].command_id, second.commands[0].command_id) == (second.macro_id, first.macro_id)


def test_merging_again_adds_nothing() -> None:
    other = msgspec.structs.replace(HUMANOID, actions=(Action(1, "Raise left arm", (Step(1, 61, 50),)), NOD))
    once, _ = merge_projects(HUMANOID, other)
    again, said = merge_projects(once, other)
    assert again == once
    assert "action 1 'Raise left arm' is action 3 'Raise left arm'" in said


def test_merging_again_adds_nothing_where_actions_are_alike() -> None:
    one = Project(actions=(Action(2, "b", (Step(1, 1, 1),)),))
    alike = tuple(Action(number, "a", (Step(1, 2, 1),)) for number in (2, 9))
    other = Project(actions=alike, macros=(Macro(1, "m", (MacroCommand(2),)),))
    project, _ = merge_projects(one, other)
    assert merge_projects(project, other)[0] == project


def test_of_what_can_be_there_once_the_first_stays() -> None:
    one = Project(project_id=1, servo_parameters=(ServoParameter(1, 0, "knee"), ServoParameter(2)))
    other = Project(
        project_id=2,
        servo_parameters=(ServoParameter(1, 4, "Knie"), ServoParameter(2, 1), ServoParameter(3), ServoParameter(4, 9)),
    )
    project, said = merge_projects(one, other)
    assert project.project_id == 1
    assert project.servo_parameters == (ServoParameter(1, 0, "knee"), ServoParameter(2, 1), ServoParameter(4, 9))
    assert said == [
        "servo 1 stays 'knee' with a correction of 0; 'Knie' with 4 is dropped",
        "servo 2 '' added",
        "servo 4 '' added",
        "project id 1 stays; 2 is dropped",
    ]
    assert merge_projects(Project(), other)[0].project_id == 2


@pytest.mark.parametrize("first", [Project(), HUMANOID])
def test_ids_that_are_used_twice_are_refused(first: Project) -> None:
    with pytest.raises(ProjectError, match="macro 4 exists twice"):
        merge_projects(first, Project(macros=(WAVE, WAVE)))
    with pytest.raises(ProjectError, match="servo parameter 3 exists twice"):
        merge_projects(first, Project(servo_parameters=(ServoParameter(3, 1), ServoParameter(3, 2))))


@pytest.mark.parametrize(
    "lost",
    [
        Project(macros=(Macro(1, "M", (MacroCommand(1),)),)),
        Project(macros=(Macro(1, "M", (MacroCommand(4, 2),)),)),
        Project(joystick_tables=(JoystickTable(1, "T", (Button(1, "", 0, 4, 0),)),)),
    ],
)
def test_a_call_of_nothing_does_not_call_something_by_chance(lost: Project) -> None:
    for one, other in [(HUMANOID, lost), (lost, HUMANOID)]:
        with pytest.raises(
            ProjectError, match=r"refers to (action|macro) \d, which is missing; correct the reference first"
        ):
            merge_projects(one, other)


ids = st.integers(1, 4)
small = st.builds(
    lambda degrees, called: Project(
        actions=tuple(Action(number, "", (Step(1, degree, 1),)) for number, degree in degrees.items()),
        macros=tuple(
            Macro(number, "", tuple(MacroCommand(one, kind) for one, kind in commands))
            for number, commands in called.items()
        ),
    ),
    st.dictionaries(ids, st.integers(0, 1), max_size=3),
    st.dictionaries(ids, st.lists(st.tuples(ids, st.sampled_from((0, 1, 2))), max_size=2), max_size=4),
)


def meaning(project: Project, macro_id: int, depth: int = 6) -> object:
    """Return what a macro does, whatever the ids are, down to some depth."""
    macro = MACRO.by_id(project).get(macro_id)
    if macro is None or depth == 0:
        return macro is None
    done: list[object] = []
    for command in macro.commands:
        if command.type == 2:
            done.append(meaning(project, command.command_id, depth - 1))
        elif command.type == 0:
            action = ACTION.by_id(project).get(command.command_id)
            done.append(action and action.steps)
        else:
            done.append(command.command_id)
    return done


def whole(project: Project) -> bool:
    """Return whether all that is called is there."""
    shelves: dict[str, dict[int, Any]] = {ACTION.label: ACTION.by_id(project), MACRO.label: MACRO.by_id(project)}
    return all(number in shelves[kind.label] for macro in project.macros for kind, number in MACRO.references(macro))


@given(small.filter(whole), small.filter(whole))
def test_each_macro_still_does_what_it_did(one: Project, other: Project) -> None:
    project, _ = merge_projects(one, other)
    assert whole(project)
    here = [meaning(project, macro.macro_id) for macro in project.macros]
    assert here[: len(one.macros)] == [meaning(one, macro.macro_id) for macro in one.macros]
    assert all(meaning(other, macro.macro_id) in here for macro in other.macros)
    assert merge_projects(project, one)[0] == project
