"""Times multiplied.

Module: servolink.project.adjust.
"""

from __future__ import annotations

import math

import pytest

from servolink.errors import ProjectError
from servolink.project.adjust import scale_project
from servolink.project.model import Project
from servolink.protocol import Action, Macro, MacroCommand, Step
from tests.project.projects import HUMANOID, NOD, PAD


def intervals(project: Project) -> list[list[int]]:
    return [[step.interval for step in action.steps] for action in project.actions]


def test_everything_takes_twice_as_long() -> None:
    project, said = scale_project(HUMANOID, 2)
    assert intervals(project) == [[100, 80, 40], [60]]
    assert project.macros == (
        Macro(4, "Wave left", (MacroCommand(1, 0, 50, 2, 4000), MacroCommand(600, 1, total_interval=600))),
        Macro(5, "Show", (MacroCommand(4, 2, total_interval=4600), MacroCommand(2, total_interval=600))),
    )
    assert (project.joystick_tables, project.servo_parameters) == ((PAD,), HUMANOID.servo_parameters)
    assert said[0] == "action 1 'Raise left arm': durations multiplied by 2"
    assert len(said) == 4


def test_only_the_actions_that_are_named() -> None:
    project, said = scale_project(HUMANOID, 0.5, [1])
    assert intervals(project) == [[25, 20, 10], [30]]
    assert (project.actions[1], project.macros) == (NOD, HUMANOID.macros)
    assert len(said) == 1


def test_nothing_is_named() -> None:
    assert scale_project(HUMANOID, 3, []) == (HUMANOID, [])


def test_times_are_whole_and_do_not_vanish() -> None:
    action = Action(1, "", (Step(1, 0, 0), Step(2, 0, 1), Step(3, 0, 25), Step(4, 0, 2)))
    project, _ = scale_project(Project(actions=(action,)), 0.3)
    assert intervals(project) == [[0, 1, 8, 1]]


def test_a_factor_of_one_changes_nothing() -> None:
    assert scale_project(HUMANOID, 1) == (HUMANOID, [])


@pytest.mark.parametrize("factor", [0, -1, math.inf, math.nan, True, "2", 10**400, 1e300])
def test_what_is_no_factor_is_refused(factor: float) -> None:
    with pytest.raises(ProjectError, match="must be above 0 and at most"):
        scale_project(HUMANOID, factor)


def test_an_action_that_is_not_there_is_named() -> None:
    with pytest.raises(ProjectError, match="no action 8"):
        scale_project(HUMANOID, 2, [1, 9, 8])


def test_times_that_are_too_long_are_refused() -> None:
    longest, _ = scale_project(HUMANOID, 0x7FFF / 50)
    assert longest.actions[0].steps[0].interval == 0x7FFF
    with pytest.raises(ProjectError, match=r"action 1 'Raise left arm', step 1: 0.5 s times 656 .* 327.67 s"):
        scale_project(HUMANOID, 656)
    with pytest.raises(ProjectError, match="is too long"):
        scale_project(HUMANOID, 0x8000 / 50)
    macro = Macro(1, "Wait", (MacroCommand(0x7FFF_FFFF, 1),))
    with pytest.raises(ProjectError, match=r"macro 1 'Wait', command 1: .* too long"):
        scale_project(Project(macros=(macro,)), 1.1)
