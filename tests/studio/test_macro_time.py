"""The page plays macros as a virtual board does: the same turns at the same times, nested, repeated and slowed down."""

from __future__ import annotations

import random
from collections import defaultdict
from typing import Any

import pytest

from servolink.project import Project, ProjectFile, RecordRun, durations
from servolink.protocol import (
    Action,
    Macro,
    MacroCommand,
    MacroCommandType,
    MacroPlaying,
    Step,
    record_from_json,
    record_to_json,
)
from tests.studio.web_code import call_all, needs_node

pytestmark = needs_node

_RANDOM = random.Random(15)
_MODULE = "state/macro-time.js"


def _action(action_id: int) -> Action:
    servo_ids = _RANDOM.sample(range(1, 6), _RANDOM.randint(0, 4))
    steps = (Step(each, _RANDOM.randint(-120, 120), _RANDOM.randint(1, 80)) for each in servo_ids)
    return Action(action_id, f"action {action_id}", tuple(steps))


def _macro(macro_id: int) -> Macro:
    """Return a macro that runs only macros with lower ids."""
    commands = []
    for _ in range(_RANDOM.randint(0, 4)):
        kind = _RANDOM.choice(
            [*MacroCommandType] if macro_id > 1 else [MacroCommandType.ACTION, MacroCommandType.DELAY]
        )
        highest = {MacroCommandType.ACTION: 3, MacroCommandType.DELAY: 900, MacroCommandType.MACRO: macro_id - 1}[kind]
        total = _RANDOM.choice([0, 0, _RANDOM.randint(1, 4000)])
        ratio, loop = _RANDOM.choice([100, 100, 80, 33, 7]), _RANDOM.randint(0, 3)
        commands.append(MacroCommand(_RANDOM.randint(1, highest), kind.value, ratio, loop, total))
    return Macro(macro_id, f"macro {macro_id}", tuple(commands))


def _project() -> Project:
    return Project(actions=tuple(map(_action, (1, 2, 3))), macros=tuple(map(_macro, (1, 2, 3))))


PROJECTS = [_project() for _ in range(60)]
FORMS = [ProjectFile(each).form() for each in PROJECTS]


def played(project: Project, macro_id: int, slowness: float = 1.0) -> tuple[list[tuple[Any, ...]], float]:
    """Return servo, start, end and target of each turn, and the time of all, as the package plays a macro."""
    now, turns = 0.0, list[tuple[Any, ...]]()

    def move(steps: tuple[Step, ...], speed: float) -> None:
        turns.extend((one.servo_id, now, now + one.seconds * slowness / speed, one.degree) for one in steps)

    actions = {one.action_id: one for one in project.actions}
    macros = {one.macro_id: one for one in project.macros}
    for pause in MacroPlaying(actions, macros, move, slowness).play(macro_id):
        now += pause
    return turns, now


@pytest.mark.parametrize("slowness", [1.0, 2.5])
def test_turns_and_times_are_those_of_the_board(slowness: float) -> None:
    courses = call_all([(_MODULE, "courseOf", [form, 3, {}, slowness]) for form in FORMS])
    for project, course in zip(PROJECTS, courses, strict=True):
        turns, seconds = played(project, 3, slowness)
        found = [(one["servoId"], one["from"], one["until"], one["end"]) for one in course["turns"]]
        assert len(found) == len(turns)
        for one, other in zip(found, turns, strict=True):
            assert one == pytest.approx(other, abs=1e-6)
        assert course["seconds"] == pytest.approx(seconds, abs=1e-6)
        assert not course["isCut"]


def test_a_course_takes_as_long_as_preflight_says() -> None:
    courses = call_all([(_MODULE, "courseOf", [form, 3]) for form in FORMS])
    for project, course in zip(PROJECTS, courses, strict=True):
        assert course["seconds"] == pytest.approx(RecordRun(project, project.macros[2]).seconds(), abs=1e-6)


def test_the_highest_speeds_are_those_of_preflight() -> None:
    start = {1: 10, 2: -20}
    courses = call_all([(_MODULE, "courseOf", [form, 3, start]) for form in FORMS])
    for project, course in zip(PROJECTS, courses, strict=True):
        expected, found = defaultdict[int, float](float), defaultdict[int, float](float)
        for move in RecordRun(project, project.macros[2]).moves(start):
            expected[move.step.servo_id] = max(expected[move.step.servo_id], move.degrees_per_second)
        for turn in course["turns"]:
            way = abs(turn["end"] - turn.get("start", turn["end"]))
            found[turn["servoId"]] = max(found[turn["servoId"]], way / (turn["until"] - turn["from"]))
        for servo_id, speed in found.items():
            assert speed == pytest.approx(expected[servo_id], rel=1e-6, abs=1e-6)


def test_durations_are_those_of_the_package() -> None:
    results = call_all([("state/durations.js", "durations", [form]) for form in FORMS])
    for project, found in zip(PROJECTS, results, strict=True):
        assert {int(macro_id): tuple(each) for macro_id, each in found.items()} == durations(project)


def test_a_macro_that_runs_itself_has_no_course() -> None:
    command = MacroCommand(1, MacroCommandType.MACRO.value)
    project = Project(macros=(Macro(1, "one", (command,)), Macro(2, "caller", (command,)), Macro(3, "good")))
    found = call_all([(_MODULE, "courseOf", [ProjectFile(project).form(), macro_id]) for macro_id in (1, 2, 3)])
    assert [course is None for course in found] == [True, True, False]


def test_an_edit_keeps_the_durations_of_all_callers_right() -> None:
    """A longer step makes each command longer that runs the action, also through other macros."""
    step, slow = Step(1, 10, 50), Step(1, 10, 90)
    run, call = MacroCommand(1, 0, 50, 2, 2000), MacroCommand(1, 2, 100, 3, 6000)
    before = Project(actions=(Action(1, "a", (step,)),), macros=(Macro(1, "m", (run,)), Macro(2, "n", (call,))))
    form = ProjectFile(before).form()
    after = {**form, "actions": [record_to_json(Action(1, "a", (slow,)))]}
    (found,) = call_all([("state/durations.js", "withDurations", [form, after])])
    macros = tuple(record_from_json(Macro, each) for each in found["macros"])
    assert [macro.commands[0].total_interval for macro in macros] == [3600, 10_800]
    assert durations(Project(actions=(Action(1, "a", (slow,)),), macros=macros)) == {1: (3600,), 2: (10_800,)}
