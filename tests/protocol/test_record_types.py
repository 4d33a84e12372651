"""Each record type finds the parts of its records and packets.

Module: servolink.protocol.records.
"""

from __future__ import annotations

from typing import Any

import pytest

from servolink.errors import ProjectError
from servolink.protocol import editing, joystick
from servolink.protocol.record_types import ACTION, MACRO, RECORD_TYPES, STORED_TYPES, TABLE, RecordType
from servolink.protocol.records import (
    Action,
    ActionEntry,
    Button,
    JoystickTable,
    Macro,
    MacroCommand,
    MacroCommandType,
    RecordRef,
    ServoParameter,
    Step,
)

WAVE = Action(3, "Wave", (Step(1, 90, 50), Step(2, -90, 120)))
SHOW = Macro(4, "Show", (MacroCommand(3), MacroCommand(500, 1), MacroCommand(4, 2), MacroCommand(9, 7)))
PAD = JoystickTable(5, "Pad", (Button(1, "A", 4, 0, 9),))


@pytest.mark.parametrize(("record", "record_type"), [(WAVE, ACTION), (SHOW, MACRO), (PAD, TABLE)])
def test_a_record_survives_the_request_that_adds_it(record: Any, record_type: RecordType[Any]) -> None:
    assert RecordType.of(record) is record_type
    request = record_type.add(record)
    assert isinstance(request, record_type.add_class)
    assert record_type.record_in(request) == record
    assert record_type.id_of(request) == record_type.id_of(record)
    assert record_type.caption_of(request) == record_type.caption_of(record)
    assert record_type.parts_of(request) == record_type.parts_of(record)


def test_id_0_is_no_record() -> None:
    assert ACTION.record_in(editing.QueryActionResponse(0, "noise")) is None
    assert TABLE.record_in(joystick.QueryJoystickTableResponse(0)) is None


def test_a_list_keeps_the_board_s_order_and_ids_listed_twice() -> None:
    entries = (ActionEntry(3, "a"), ActionEntry(1, "b"), ActionEntry(3, "a"))
    response = editing.QueryActionListResponse(entries)
    assert ACTION.ids_in(response) == (3, 1, 3)
    assert ACTION.entries_in(response) == entries


def test_references_are_those_of_known_types() -> None:
    assert list(ACTION.references(WAVE)) == []
    assert list(MACRO.references(SHOW)) == [(ACTION, 3), (MACRO, 4)]
    assert list(TABLE.references(PAD)) == [(MACRO, 4), (MACRO, 0), (MACRO, 9)]


def test_only_references_are_replaced() -> None:
    assert ACTION.with_references(WAVE, lambda _, old: old + 100) == WAVE
    assert [one.command_id for one in MACRO.with_references(SHOW, lambda _, old: old + 100).commands] == [
        103,
        500,
        104,
        9,
    ]
    assert TABLE.with_references(PAD, lambda _, old: old and old + 100).buttons == (Button(1, "A", 104, 0, 109),)


def test_references_to_objects_stay_objects() -> None:
    (command,) = Macro.of("m", WAVE).commands
    ((_, reference),) = MACRO.references(Macro(1, "m", (command,)))
    assert isinstance(reference, RecordRef)
    assert reference.record is WAVE


@pytest.mark.parametrize("record_type", RECORD_TYPES, ids=str)
def test_as_many_entries_are_listed_as_fit_a_frame(record_type: RecordType[Any]) -> None:
    assert record_type.list_size(record_type.list_limit) <= 0xFFFF < record_type.list_size(record_type.list_limit + 1)


def test_types_come_in_the_order_of_a_project_file() -> None:
    assert [one.field for one in STORED_TYPES] == ["servo_parameters", "actions", "macros", "joystick_tables"]
    assert [str(one) for one in STORED_TYPES] == ["servo parameter", "action", "macro", "joystick table"]
    assert STORED_TYPES[0].caption_of(ServoParameter(1, 3, "elbow")) == "elbow"


def test_whatever_is_not_a_record_has_no_type() -> None:
    with pytest.raises(ProjectError, match="'wave' is not an action, a macro or a joystick table"):
        RecordType.of("wave")


def test_times_are_in_seconds() -> None:
    assert WAVE.steps[1].seconds == WAVE.seconds == 1.2
    assert Action(1).seconds == 0
    assert [one.value for one in MacroCommandType] == [0, 1, 2]
