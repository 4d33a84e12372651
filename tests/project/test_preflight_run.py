"""What a board would do is found beyond limits just if it is, compared with a player of macros."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.motion import MotionLimits
from servolink.project.model import Project
from servolink.project.preflight_checks import preflight_run, uncheckable
from servolink.project.speed import RecordRun
from servolink.protocol import Action, Codec, Macro, MacroCommand, Step
from servolink.virtual import BoardKind, Player, Storage
from tests.project.pulled import contents_of

SERVOS = (1, 2, 3)


class Probe:
    """A servo that keeps its highest speed and its extreme angles."""

    def __init__(self, angle: float) -> None:
        self.angle = angle
        self.speed = 0.0
        self.angles: list[float] = []

    def move(self, degree: int, seconds: float, now: float) -> None:
        if degree != self.angle:
            self.speed = max(self.speed, abs(degree - self.angle) / seconds)
        self.angle = degree
        self.angles.append(degree)


def played(project: Project, record: Action | Macro, start: dict[int, int]) -> dict[int, Probe]:
    """Return what the servos do when a virtual board runs `record`."""
    probes = {servo_id: Probe(angle) for servo_id, angle in start.items()}
    storage = Storage(BoardKind(memory=1 << 20))
    storage.contents = contents_of(project)
    servos: Any = probes
    player = Player(servos, storage, Codec())
    if isinstance(record, Action):
        player.run_action(record.action_id, 0.0)
    else:
        assert player.run_macro(record.macro_id, 0.0)
    while player.due is not None:
        player.advance(player.due, player.due)
    return probes


DEGREES = st.integers(-90, 90)


@st.composite
def projects(draw: st.DrawFn) -> Project:
    actions = tuple(
        Action(
            number,
            f"a{number}",
            tuple(
                Step(servo_id, draw(DEGREES), draw(st.integers(1, 60)))
                for servo_id in draw(st.lists(st.sampled_from(SERVOS), unique=True, max_size=3))
            ),
        )
        for number in (1, 2, 3)
    )
    macros = []
    for number in range(1, draw(st.integers(2, 5))):
        called = st.tuples(st.just(0), st.integers(1, 3)) | st.tuples(st.just(1), st.integers(0, 500))
        if number > 1:
            called |= st.tuples(st.just(2), st.integers(1, number - 1))
        commands = tuple(
            MacroCommand(called_id, kind, draw(st.sampled_from([100, 50, 30, 1])), draw(st.integers(1, 3)))
            for kind, called_id in draw(st.lists(called, max_size=4))
        )
        macros.append(Macro(number, f"m{number}", commands))
    return Project(actions=actions, macros=tuple(macros))


def needed(project: Project, record: Action | Macro) -> Project:
    """Return only what `record` runs."""
    if isinstance(record, Action):
        return Project(actions=(record,))
    actions, macros = {one.action_id: one for one in project.actions}, {one.macro_id: one for one in project.macros}
    found, waiting = [record], [record]
    used: dict[int, Action] = {}
    while waiting:
        for command in waiting.pop().commands:
            if command.type == 0:
                used[command.command_id] = actions[command.command_id]
            elif command.type == 2 and macros[command.command_id] not in found:
                found.append(macros[command.command_id])
                waiting.append(found[-1])
    return Project(actions=tuple(used.values()), macros=tuple(found))


@given(
    project=projects(),
    start=st.fixed_dictionaries(dict.fromkeys(SERVOS, DEGREES)),
    caps=st.dictionaries(st.sampled_from(SERVOS), st.floats(1, 400)),
    angles=st.dictionaries(st.sampled_from(SERVOS), st.tuples(st.integers(-90, -40), st.integers(40, 90))),
    data=st.data(),
)
def test_a_run_exceeds_limits_just_if_a_servo_does(
    project: Project,
    start: dict[int, int],
    caps: dict[int, float],
    angles: dict[int, tuple[int, int]],
    data: st.DataObject,
) -> None:
    records: tuple[Action | Macro, ...] = (*project.actions, *project.macros)
    record = data.draw(st.sampled_from(records))
    stored = needed(project, record)
    assert list(uncheckable(stored)) == []
    run = RecordRun(stored, record)
    probes = played(project, record, start)
    limits = MotionLimits(angles, speed_caps=caps)
    exceeded = {
        servo_id
        for servo_id, probe in probes.items()
        if any(limits.exceeded_angles(servo_id, angle) for angle in probe.angles)
        or (probe.speed > caps.get(servo_id, math.inf) and not math.isclose(probe.speed, caps[servo_id]))
    }
    found = list(preflight_run(run, stored, limits, start))
    assert {int(text.partition("asks servo ")[2].split()[0]) for text in found} == exceeded
    assert run.first_pose() == {servo_id: probe.angles[0] for servo_id, probe in probes.items() if probe.angles}


UP, DOWN = Action(1, "up", (Step(1, 90, 50),)), Action(2, "down", (Step(1, -90, 100),))
BEND = Macro(5, "b{}nd", (MacroCommand(1), MacroCommand(2)))


def texts(*records: Action | Macro, start: int = 0, unit: float = 0.01, **limits: Any) -> list[str]:
    """Return what is found for a run of the last of `records`."""
    stored = Project(
        actions=tuple(one for one in records if isinstance(one, Action)),
        macros=tuple(one for one in records if isinstance(one, Macro)),
    )
    run = RecordRun(stored, records[-1], unit)
    return list(preflight_run(run, stored, MotionLimits(**limits), {1: start}))


def test_a_text_names_records_step_servo_speed_and_limit() -> None:
    assert texts(UP, speed_cap=100, source="an argument") == [
        "action 1 'up', step 1 asks servo 1 for 180 degrees/s; its cap is 100 (from an argument)"
    ]
    assert texts(UP, angles=(-90, 80)) == [
        "action 1 'up', step 1 asks servo 1 to go to 90 degrees; its limits are -90..80"
    ]
    whole = Macro(4, "whole", (MacroCommand(5, 2, 90),))
    assert texts(UP, DOWN, BEND, whole, start=90, speed_cap=150) == [
        "macro 5 'b{}nd', command 2: action 2 'down', step 1 asks servo 1 for 162 degrees/s; its cap is 150"
    ]


def test_a_macro_that_is_run_slowly_may_be_too_fast_alone() -> None:
    whole = Macro(4, "whole", (MacroCommand(5, 2, 50),))
    assert texts(UP, DOWN, BEND, whole, speed_cap=100) == []
    assert len(texts(UP, DOWN, BEND, start=0, speed_cap=100)) == 2


def test_a_repeated_record_starts_where_it_ended() -> None:
    once, twice = (Macro(6, "again", (MacroCommand(5, 2, 100, loop),)) for loop in (1, 2))
    assert not any("macro 6" in text for text in texts(UP, DOWN, BEND, once, speed_cap=200, start=90))
    assert texts(UP, DOWN, BEND, twice, speed_cap=200, start=90) == [
        "macro 6 'again', command 1: action 1 'up', step 1 asks servo 1 for 360 degrees/s; its cap is 200"
    ]


@pytest.mark.parametrize("ratios", [(100, 50), (50, 100)])
def test_the_highest_speed_at_which_a_macro_is_run_counts(ratios: tuple[int, int]) -> None:
    middle = Macro(3, "middle", tuple(MacroCommand(5, 2, ratio) for ratio in ratios))
    whole = Macro(2, "whole", (MacroCommand(3, 2, 50),))
    inner = "macro 5 'b{}nd', command 2: action 2 'down', step 1 asks servo 1 for 90 degrees/s"
    assert [text for text in texts(UP, DOWN, BEND, middle, whole, speed_cap=80) if inner in text]
    assert not [text for text in texts(UP, DOWN, BEND, middle, whole, speed_cap=95) if "macro 5" in text]


def test_intervals_are_counted_in_the_unit_of_the_board() -> None:
    assert texts(UP, speed_cap=100, unit=0.02) == []
    assert texts(UP, speed_cap=179, unit=0.01) != []


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (Action(1, "a", (Step(1, 0, 1), Step(2, 0, 1), Step(1, 5, 1))), "action 1 'a' moves servo 1 twice"),
        (Macro(1, "m", (MacroCommand(5, 3),)), "macro 1 'm', command 1 is of type 3"),
        (Macro(1, "m", (MacroCommand(5, 1, 0), MacroCommand(1, 0, 101))), "command 2 has the ratio 101"),
        (Macro(1, "m", (MacroCommand(1, 2, 0),)), "command 1 has the ratio 0"),
        (Macro(1, "m", (MacroCommand(1, 2),)), "macro 1 'm' never ends"),
    ],
)
def test_what_the_document_does_not_describe_cannot_be_checked(record: Action | Macro, words: str) -> None:
    stored = Project(actions=(record,)) if isinstance(record, Action) else Project(macros=(record,))
    assert words in next(uncheckable(stored))


def test_macros_that_run_each_other_often_are_looked_at_once_each() -> None:
    """Played in full, this would take 3 ** 500 actions."""
    deep = [Macro(number, "", (MacroCommand(number + 1, 2, 100, 3),) * 3) for number in range(1, 500)]
    stored = Project(actions=(UP, DOWN), macros=(*deep, Macro(500, "", BEND.commands)))
    found = list(preflight_run(RecordRun(stored, deep[0]), stored, MotionLimits(speed_cap=100), {1: 0}))
    assert len(found) < 10_000
