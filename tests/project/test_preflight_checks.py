"""Movements that are too fast or go too far."""

from __future__ import annotations

from servolink.project.build import build_project
from servolink.project.model import Project
from servolink.project.preflight_checks import preflight
from servolink.protocol import Action, Macro, MacroCommand, Step
from tests.project.projects import HUMANOID, NOD, RAISE

LEFT = Action.pose("Left", {3: -62}, seconds=0.5)
RIGHT = Action.pose("Right", {1: 20, 3: 62}, seconds=0.4)
SWING = Macro.of("Swing", LEFT, RIGHT)
PROJECT = build_project(NOD, SWING)


def test_a_servo_that_is_too_fast() -> None:
    found = preflight(PROJECT, speed_cap=200)
    assert [str(one) for one in found] == [
        "macros[0].commands[1]: action 3 'Right', step 2 asks servo 3 for 310 degrees/s; its cap is 200"
    ]
    assert preflight(PROJECT, speed_cap=310) == []


def test_the_pose_before_counts_when_it_is_known() -> None:
    found = preflight(PROJECT, speed_cap=100, start={3: 0, 5: 0})
    assert [one.path for one in found] == [
        "actions[1].steps[0]",
        "actions[2].steps[1]",
        "macros[0].commands[0]",
        "macros[0].commands[1]",
    ]
    assert found[0].text == "step 1 asks servo 3 for 124 degrees/s; its cap is 100"


def test_angles_outside_their_limits() -> None:
    assert preflight(PROJECT, angle_limits=(-62, 62)) == []
    found = preflight(PROJECT, angle_limits=(-62, 61.5))
    assert [str(one) for one in found] == [
        "actions[2].steps[1]: step 2 asks servo 3 to go to 62 degrees; its limits are -62..61.5"
    ]
    assert [one.path for one in preflight(PROJECT, angle_limits={1: (-5, 5), 3: (-90, 90)})] == ["actions[2].steps[0]"]


def test_only_what_is_run() -> None:
    macro = PROJECT.macros[0]
    assert (
        preflight(PROJECT, [PROJECT.actions[0]], speed_cap=100, angle_limits=(-1, 1))[0].path == "actions[0].steps[0]"
    )
    paths = [one.path for one in preflight(PROJECT, [macro], speed_cap=100, angle_limits=(-1, 1))]
    assert paths == ["actions[1].steps[0]", "actions[2].steps[0]", "actions[2].steps[1]", "macros[0].commands[1]"]
    assert preflight(PROJECT, [], speed_cap=1, angle_limits=(0, 0)) == []


def test_calls_in_a_circle_and_of_nothing_end() -> None:
    one, two = Macro(1, "", (MacroCommand(2, 2), MacroCommand(9))), Macro(2, "", (MacroCommand(1, 2), MacroCommand(1)))
    project = Project(actions=(RAISE,), macros=(one, two))
    assert len(preflight(project, [one], angle_limits=(0, 0))) == len(RAISE.steps)


def test_nothing_is_looked_at_without_limits() -> None:
    assert preflight(HUMANOID) == []


def test_a_step_that_takes_no_time_is_too_fast() -> None:
    jump = Action(1, "Jump", (Step(1, 10, 0),))
    assert "to turn in no time" in preflight(Project(actions=(jump,)), speed_cap=1e9, start={1: 0})[0].text
