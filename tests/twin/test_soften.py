"""Softer macros: the least slowing or the largest angles with which a robot stands, and what is left alone.

Module: servolink.twin.softening, servolink.cli.projects.twin.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from msgspec.structs import replace

from servolink.project import Figure, Project, ProjectFile, fix_project, load_project, save_project, validate_project
from servolink.protocol import Action, Macro, MacroCommand, MacroCommandType, Step
from servolink.twin.body import Body
from servolink.twin.forecasts import Verdict, forecast
from servolink.twin.softening import soften
from tests.cli.programs import call
from tests.twin.figures import lamp

LAMP = Body.of(lamp())
UP = Action(1, "Up", (Step(1, 0, 60), Step(2, 0, 60)))
FAR = Action(2, "Far", (Step(1, 60, 50), Step(2, 40, 50)))
QUICK = Action(3, "Quick", (Step(1, 30, 8),))
READ = Macro(1, "Read", (MacroCommand(2), MacroCommand(1)))
JERK = Macro(2, "Jerk", (MacroCommand(3), MacroCommand(3, ratio=50), MacroCommand(100, MacroCommandType.DELAY)))
NOD = Macro(3, "Nod", (MacroCommand(1),))
PROJECT, _ = fix_project(Project(actions=(UP, FAR, QUICK), macros=(READ, JERK, NOD)))
READ, JERK, NOD = PROJECT.macros


def verdicts(project: Project) -> list[Verdict]:
    return [one.verdict for one in forecast(project, LAMP, project.macros)]


def test_a_quick_macro_gets_slower_and_a_far_one_smaller() -> None:
    assert Verdict.STANDS not in verdicts(PROJECT)[:2]
    found = soften(PROJECT, LAMP, PROJECT.macros)
    assert found.unsolved == ()
    assert verdicts(found.project) == [Verdict.STANDS] * 3
    read, jerk, nod = found.project.macros
    assert (read.commands[0].ratio, nod) == (100, NOD), "no slowing helps one, and the other stands"
    ratios = [command.ratio for command in jerk.commands]
    assert 25 <= ratios[0] < 100
    assert ratios[1:] == [pytest.approx(ratios[0] / 2, abs=1), 100]
    up, far, quick = found.project.actions
    assert (up, quick) == (UP, QUICK)
    assert 18 <= far.steps[0].degree < 60
    assert [change for change in found.changes if "multiplied" in change] == [
        f"macro 1 'Read': angles of action 1 'Up', action 2 'Far' multiplied by {far.steps[0].degree / 60:.2g}",
        f"macro 2 'Jerk': speed of its commands multiplied by {ratios[0] / 100:g}",
    ]
    assert validate_project(found.project) == []


def test_only_the_macros_asked_for_change() -> None:
    found = soften(PROJECT, LAMP, [JERK])
    assert found.project.actions == PROJECT.actions
    assert [one for one, other in zip(found.project.macros, PROJECT.macros, strict=True) if one == other] == [READ, NOD]


def test_a_macro_that_nothing_helps_is_unsolved() -> None:
    wait = Macro(1, "Wait", (MacroCommand(1000, MacroCommandType.DELAY),))
    found = soften(Project(macros=(wait,)), Body.of(falling()), [wait])
    assert found == (Project(macros=(wait,)), (), (wait,))


def falling() -> Figure:
    """Return a lamp with its centre of mass beside the base."""
    made = lamp()
    return replace(made, joints=(made.joints[0], made.joints[1], replace(made.joints[2], at=(0, 200, 200), mass=1.0)))


def test_the_command_proposes_writes_and_says_what_is_left(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, out = str(tmp_path / "robot.json"), tmp_path / "soft.json"
    save_project(source, PROJECT, figure=lamp())
    before = Path(source).read_bytes()
    said = call(capsys, "twin", "soften", source, "--macro", "Jerk")
    assert (said.code, said.err) == (0, "")
    assert said.out.startswith("macro 2 'Jerk': speed of its commands multiplied by 0.")
    assert said.out.endswith("nothing was written; -o OUT or --in-place does\n")
    assert Path(source).read_bytes() == before
    said = call(capsys, "twin", "soften", source, "--macro", "Jerk", "-o", str(out))
    assert (said.code, said.out.splitlines()[-1]) == (0, f"{out}: written")
    assert load_project(out) == soften(PROJECT, LAMP, [JERK]).project
    assert ProjectFile.read(out).figure == ProjectFile.read(source).figure
    said = call(capsys, "twin", "soften", str(out), "--macro", "Nod")
    assert (said.code, said.out) == (0, "the robot stands in all macros: nothing to change\n")
    save_project(source, PROJECT, figure=falling())
    said = call(capsys, "twin", "soften", source, "--macro", "Nod")
    assert (said.code, said.out) == (
        1,
        "macro 3 'Nod': no speed down to 25 % and no angles down to 30 % let the robot stand; change the poses\n",
    )
    said = call(capsys, "twin", "soften", source, "--macro", "Nod", "--json")
    assert (said.code, json.loads(said.out)) == (
        1,
        {"file": None, "written": False, "changes": [], "unsolved": [3]},
    )
