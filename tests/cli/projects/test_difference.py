"""What differs between two projects, in words."""

from __future__ import annotations

from difflib import SequenceMatcher
from typing import Any

import pytest

from servolink.cli.projects.apply import PlanShown, plan_text
from servolink.cli.screen.result import print_for_people
from servolink.cli.stored import record_tables as difference
from servolink.cli.stored.record_tables import lines_of
from servolink.project import UNFINISHED, Change, Memory, Plan, Project, compare
from servolink.protocol import Action, Button, JoystickTable, Macro, MacroCommand, ServoParameter, Step

OLD = Project(
    UNFINISHED.start + 7,
    (ServoParameter(1, 3, "knee"), ServoParameter(2, 1, "hip")),
    (Action(1, "Bow", (Step(1, 30, 50), Step(2, 5, 100))), Action(2, "Gone", (Step(1, 1, 20),))),
    (Macro(4, "Greet", (MacroCommand(1, total_interval=1000), MacroCommand(500, 1, total_interval=500))),),
    (JoystickTable(3, "Pad", (Button(7, "greet", 4),)),),
    3,
)
NEW = Project(
    8,
    (ServoParameter(1, 4, "Knee"),),
    (Action(1, "Bow", (Step(1, 30, 50), Step(2, 6, 100), Step(3, 0, 1))), Action(3, "New", ())),
    (
        Macro(4, "Greet", (MacroCommand(4, 2, ratio=50, loop=2), MacroCommand(9, 77))),
        Macro(5, "Rest", (MacroCommand(1, 1),)),
    ),
    (JoystickTable(3, "Pad", (Button(7, "greet", 4, 0, 5, 1),)), JoystickTable(6, "Other", ())),
    6,
)


def test_every_kind_of_change_has_its_words() -> None:
    assert [line for change in compare(OLD, NEW) for line in lines_of(change)] == [
        "~ project id: an unfinished import -> 8",
        "~ servo parameter 1 'Knee'",
        "    caption 'knee' -> 'Knee'",
        "    - corrected by 3\N{DEGREE SIGN}",
        "    + corrected by 4\N{DEGREE SIGN}",
        "- servo parameter 2 'hip': corrected by 1\N{DEGREE SIGN}",
        "~ action 1 'Bow'",
        "    - step 2: servo 2 to 5 in 1 s",
        "    + step 2: servo 2 to 6 in 1 s",
        "    + step 3: servo 3 to 0 in 0.01 s",
        "- action 2 'Gone': 1 step, 0.2 s",
        "+ action 3 'New': 0 steps, 0 s",
        "~ macro 4 'Greet'",
        "    - action 1, 100 % speed, once, 1 s in all",
        "    - wait 0.5 s, 100 % speed, once, 0.5 s in all",
        "    + macro 4, 50 % speed, 2 times, 0 s in all",
        "    + command of type 77: 9, 100 % speed, once, 0 s in all",
        "+ macro 5 'Rest': 1 command",
        "~ joystick table 3 'Pad'",
        "    - button 7 'greet': press 4, long press none, up none",
        "    + button 7 'greet': press 4, long press none, up 5, uninterruptible",
        "+ joystick table 6 'Other': 0 buttons",
        "~ active joystick table: 3 -> 6",
    ]
    assert list(lines_of(Change("project id", None, 5))) == ["+ project id: 5"]
    assert list(lines_of(Change("project id", 5, None))) == ["- project id: 5"]


def changed(old: list[MacroCommand], new: list[MacroCommand]) -> list[str]:
    """Return how the change of a macro's commands reads, but for its caption."""
    return list(lines_of(Change("macro 1", Macro(1, "m", tuple(old)), Macro(1, "m", tuple(new)))))[1:]


A, B, C = (MacroCommand(number) for number in (1, 2, 3))
SAID = {number: f"action {number}, 100 % speed, once, 0 s in all" for number in (1, 2, 3)}


def test_one_command_among_thousands_that_are_alike_is_found_without_comparing_all_with_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    compared: list[int] = []

    class Counting(SequenceMatcher[str]):
        def __init__(self, _: Any, old: list[str], new: list[str], **options: Any) -> None:
            compared.append(len(old) * len(new))
            super().__init__(None, old, new, **options)

    monkeypatch.setattr(difference, "SequenceMatcher", Counting)
    alike = [A] * 2500
    assert changed(alike + alike, [*alike, B, *alike]) == [f"    + {SAID[2]}"]
    assert changed([*alike, B, *alike], alike + alike) == [f"    - {SAID[2]}"]
    assert changed(alike, [*alike, A]) == [f"    + {SAID[1]}"]
    both = changed([B, *alike, C], [C, *alike, B])
    assert len(both) == 2 * len(alike) + 4  # too many to find out that all but two are the same
    assert max(compared) <= 1_000_000


def test_a_plan_names_what_the_board_lists_wrongly(capsys: pytest.CaptureFixture[str]) -> None:
    plan = Plan(
        (), ("action 1 is listed more than once",), 20, 300, 0.5, Memory(None, None, 100, 143), is_unfinished=False
    )
    print_for_people(plan_text(plan))
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "! action 1 is listed more than once"
    assert [" ".join(line.split()) for line in said[2:]] == [
        "differences 1",
        "transfer 300 bytes in 20 requests, with backup and verification",
        "takes about 1 s",
        "memory free 100, in a unit not learnt so far",
    ]
    assert PlanShown.of(plan).inconsistencies == ("action 1 is listed more than once",)
