"""Records by caption and id."""

from __future__ import annotations

from typing import Any

import pytest

from servolink.errors import ProjectError
from servolink.project.model import Project
from servolink.protocol import ACTION, MACRO, RECORD_TYPES, TABLE, Action, Macro, RecordType
from tests.project.projects import HUMANOID, NOD, PAD, RAISE, SHOW, WAVE


@pytest.mark.parametrize(
    ("name", "record"),
    [
        ("Nod", NOD),
        ("nod", NOD),
        ("RAISE LEFT ARM", RAISE),
        ("1", RAISE),
        ("action:2", NOD),
        ("macro:5", SHOW),
        ("4", WAVE),
        ("table:7", PAD),
        ("0007", PAD),
    ],
)
def test_what_is_meant(name: str, record: object) -> None:
    assert HUMANOID.find(name, RECORD_TYPES) is record


TWO = Project(actions=(Action(3, "Wave"), Action(4, "wave")), macros=(Macro(3, "Wave"), Macro(5, "4")))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("Wave", "'Wave' may be action 3 'Wave' or macro 3 'Wave'; write action:3 or macro:3"),
        ("3", "'3' may be action 3 'Wave' or macro 3 'Wave'"),
        ("action:9", "there is no action or macro 'action:9'; there is action 3 'Wave', action 4 'wave', macro 3"),
        (
            "Wavy",
            r"there is no action or macro 'Wavy'; did you mean action 3 'Wave', action 4 'wave' or macro 3",
        ),
        ("WAVE", "may be action 3 'Wave' or action 4 'wave' or macro 3 'Wave'"),
        (
            "none",
            "there is no action or macro 'none'; there is action 3 'Wave', action 4 'wave', macro 3 'Wave' and macro",
        ),
        ("table:3", "there is no action or macro 'table:3'"),
        ("٣", "there is no"),
        ("\x1b[2J", r"there is no action or macro '\\x1b\[2J'"),
    ],
)
def test_what_is_not_clear(name: str, text: str) -> None:
    with pytest.raises(ProjectError, match=text):
        TWO.find(name, (ACTION, MACRO))


def test_exactly_that_caption_comes_first() -> None:
    assert TWO.find("wave", (ACTION, MACRO)).action_id == 4
    assert TWO.find("action:3", (ACTION, MACRO)).action_id == 3
    assert TWO.find("4", (ACTION, MACRO)).action_id == 4
    assert TWO.find("name:4", (ACTION, MACRO)).macro_id == 5


@pytest.mark.parametrize("kind", [ACTION, MACRO, TABLE], ids=str)
def test_of_nothing_nothing_is_found(kind: RecordType[Any]) -> None:
    with pytest.raises(ProjectError, match="there are no "):
        Project().find("1", (kind,))
    many = Project(actions=tuple(Action(number) for number in range(1, 40)))
    with pytest.raises(ProjectError, match=r"there is action 1, action 2, action 3, action 4, action 5 and 34 more$"):
        many.find("none", (ACTION,))
