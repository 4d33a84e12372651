"""Trials of actions and macros: falls, the step that runs then, collisions, torque, lag and the margin.

Module: servolink.twin.trial, servolink.twin.moment.
"""

from __future__ import annotations

import math

import pytest
from msgspec.structs import replace

from servolink.errors import ProjectError
from servolink.project import Project
from servolink.protocol import Action, Macro, MacroCommand, MacroCommandType, Step
from servolink.twin.body import GRAVITY, Body
from servolink.twin.moment import AFTER, moment
from servolink.twin.simulation import Physics
from servolink.twin.trial import Variation, run_seconds, run_trial
from tests.twin.figures import LIMB, arm, body, template

HUMANOID = Physics(Body.of(template("humanoid-16")))
RAISE = Action(1, "Raise", (Step(1, 90, 50),))
STAND = Action(1, "Stand", (Step(8, 0, 50), Step(13, 0, 50)))
BOW = Action(2, "Bow", (Step(8, 80, 70), Step(13, -80, 70)))
BOWING = Macro(3, "Bowing", (MacroCommand(1), MacroCommand(2, ratio=50), MacroCommand(900, MacroCommandType.DELAY)))
SHOW = Macro(4, "Show", (MacroCommand(300, MacroCommandType.DELAY), MacroCommand(3, MacroCommandType.MACRO, loop=2)))
PROJECT = Project(actions=(STAND, BOW), macros=(BOWING, SHOW))


def test_a_bow_that_leaves_the_sole_falls_in_its_step() -> None:
    trial = run_trial(HUMANOID, PROJECT, SHOW)
    assert trial.fall is not None
    assert trial.fall.step == "command 2, macro 3 'Bowing', command 2, action 2 'Bow'"
    assert 1 < trial.fall.seconds < 2.5
    assert trial.worst_tilt > 45
    assert trial.margin_mm is not None
    assert trial.margin_mm < 0


def test_a_robot_that_stands_has_a_margin() -> None:
    trial = run_trial(HUMANOID, PROJECT, STAND)
    assert trial.fall is None
    assert trial.worst_tilt < 1
    assert trial.margin_mm == pytest.approx(38.5, abs=1), "from the centre of mass to the heel"
    assert trial.collisions == ()


@pytest.mark.parametrize(
    ("seconds", "step"),
    [
        (0.2, "command 1, a pause"),
        (0.5, "command 2, macro 3 'Bowing', command 1, action 1 'Stand'"),
        (2.1, "command 2, macro 3 'Bowing', command 2, action 2 'Bow'"),
        (2.5, "command 2, macro 3 'Bowing', command 3, a pause"),
        (3.3, "command 2, macro 3 'Bowing', command 1, action 1 'Stand'"),
        (5.8, "command 2, macro 3 'Bowing', command 3, a pause"),
        (7.0, AFTER),
    ],
)
def test_a_moment_is_named_by_command_and_action(seconds: float, step: str) -> None:
    assert moment(PROJECT, SHOW, seconds).step == step


def test_a_slow_action_is_tried_to_its_end() -> None:
    slow = Action(2, "Bow", (Step(8, 80, 600), Step(13, -80, 600)))
    twice = Macro(3, "Bowing", (MacroCommand(2, loop=2),))
    project = Project(actions=(slow,), macros=(twice,))
    assert (run_seconds(project, slow), run_seconds(project, twice)) == (6.0, 12.0)
    trial = run_trial(HUMANOID, project, slow)
    assert trial.fall is not None
    assert trial.fall.seconds > 3


def test_a_moment_of_a_run_of_years_is_found_at_once() -> None:
    loops = [
        Macro(at, f"Loop {at}", (MacroCommand(at - 1, MacroCommandType.MACRO, loop=30_000),)) for at in range(5, 9)
    ]
    project = replace(PROJECT, macros=(*PROJECT.macros, *loops))
    assert run_seconds(project, loops[-1]) > 1e18
    found = moment(project, loops[-1], 3e9)
    assert found.step.startswith(
        "command 1, macro 7 'Loop 7', command 1, macro 6 'Loop 6', command 1, macro 5 'Loop 5'"
    )


def test_a_moment_of_an_action_is_the_action() -> None:
    assert moment(PROJECT, BOW, 0.7).step == "action 2 'Bow'"
    assert moment(PROJECT, BOW, 0.8).step == AFTER


def test_torque_and_lag_follow_from_weight_and_stiffness() -> None:
    project = Project(actions=(RAISE,))
    trial = run_trial(Physics(arm(torque=2, stiffness=0.5)), project, RAISE)
    held = 0.4 * GRAVITY * 0.1
    assert held / 2 < trial.torque[1] < 0.8
    assert held / 0.5 < trial.lag[1] < 30
    assert (trial.fall, trial.margin_mm) == (None, None), "a bolted arm cannot fall"
    heavy = run_trial(Physics(arm(torque=2, stiffness=0.5)), project, RAISE, Variation(mass=1.2))
    assert heavy.torque[1] > trial.torque[1]


def test_a_weak_servo_stalls() -> None:
    weak = run_trial(Physics(arm(torque=0.2, stiffness=0.5)), Project(actions=(RAISE,)), RAISE)
    assert weak.torque[1] == pytest.approx(1)
    assert weak.lag[1] > 30, "degrees short of the target"


def test_parts_that_touch_are_named_with_the_time() -> None:
    limbs = [{"id": name, "servo": at, "at": [0, 400, 60 * at], "shapes": [LIMB]} for at, name in enumerate("ab", 1)]
    swing = Action(1, "Swing", (Step(1, -60, 100),))
    trial = run_trial(Physics(body(*limbs, body={"torque": 2})), Project(actions=(swing,)), swing)
    (collision,) = trial.collisions
    assert collision.parts == ("a", "b")
    gap = math.degrees(math.atan(40 / 200))
    assert gap / 60 < collision.seconds < 3 * gap / 60


def test_an_arm_that_reaches_the_table_touches_the_floor() -> None:
    low = body({"id": "arm", "servo": 1, "at": [0, 100, 0], "length": 150, "along": [0, 0, 1]}, body={"torque": 1})
    down = Action(1, "Down", (Step(1, 60, 50),))
    (collision,) = run_trial(Physics(low), Project(actions=(down,)), down).collisions
    assert collision.parts == ("arm", "floor")


def test_a_macro_that_no_board_plays_is_refused() -> None:
    endless = Macro(1, "Endless", (MacroCommand(1, MacroCommandType.MACRO),))
    with pytest.raises(ProjectError, match="macro 1 'Endless': cannot be played: macro 1 runs itself"):
        run_trial(HUMANOID, Project(macros=(endless,)), endless)
