"""Other captions."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from servolink.errors import ProjectError
from servolink.project.adjust import rename_record, rename_servo
from servolink.project.model import Project
from servolink.protocol import ACTION, MACRO, TABLE, RecordType, ServoParameter
from tests.project.projects import HUMANOID, PAD, RAISE, WAVE


@pytest.mark.parametrize(("kind", "record_id"), [(ACTION, 1), (MACRO, 4), (TABLE, 7)], ids=str)
def test_only_the_caption_changes(kind: RecordType[Any], record_id: int) -> None:
    before = kind.by_id(HUMANOID)[record_id]
    project, said = rename_record(HUMANOID, before, "新名")
    after = kind.by_id(project)[record_id]
    assert after == msgspec.structs.replace(before, **{before.__struct_fields__[1]: "新名"})
    assert rename_record(project, before, kind.caption_of(before))[0] == HUMANOID
    assert said == [f"{kind.label} {record_id} '{kind.caption_of(before)}' is now '新名'"]


def test_a_servo_gets_a_caption_and_keeps_its_correction() -> None:
    project, said = rename_servo(HUMANOID, 1, "arm")
    assert project.servo_parameters[0] == ServoParameter(1, 3, "arm")
    assert said == ["servo 1 'left shoulder' is now 'arm'"]
    fresh, _ = rename_servo(HUMANOID, 9, "tail")
    assert fresh.servo_parameters == (*HUMANOID.servo_parameters, ServoParameter(9, 0, "tail"))


def test_the_same_caption_changes_nothing() -> None:
    assert rename_record(HUMANOID, RAISE, RAISE.action_caption) == (HUMANOID, [])
    assert rename_servo(HUMANOID, 5, "neck") == (HUMANOID, [])
    assert rename_servo(HUMANOID, 6, "") == (HUMANOID, [])


def test_hostile_captions_are_shown_as_text() -> None:
    project = Project(macros=(msgspec.structs.replace(WAVE, macro_caption="\x1b[2J"),), joystick_tables=(PAD,))
    assert rename_record(project, WAVE, "\u202ex")[1] == [r"macro 4 '\x1b[2J' is now '\u202ex'"]


@pytest.mark.parametrize(("kind", "word"), [(ACTION, "action"), (MACRO, "macro"), (TABLE, "joystick table")], ids=str)
def test_what_is_not_there_is_named(kind: RecordType[Any], word: str) -> None:
    with pytest.raises(ProjectError, match=f"there is no {word} 99"):
        rename_record(HUMANOID, kind.record_class(99), "x")
