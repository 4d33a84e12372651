"""Records as JSON: the form of project files, in both directions."""

from __future__ import annotations

import json
from typing import Any

import pytest

from servolink.errors import EncodeError
from servolink.protocol.json_form import record_from_json, record_to_json
from servolink.protocol.records import Action, Button, JoystickTable, Macro, MacroCommand, ServoParameter, Step

MACRO = Macro(4, "Show", (MacroCommand(3), MacroCommand(500, 1, 50, 2, 2000), MacroCommand(4, 2)))
RECORDS = [
    Action(3, "Wave", (Step(1, 90, 50), Step(2, -90, 120))),
    MACRO,
    JoystickTable(5, "Pad", (Button(1, "A", 4, 0, 9, 1),)),
    ServoParameter(7, -3, "elbow"),
    Step(1, 90, 50),
    MacroCommand(500, 1),
]


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_a_record_survives_json(record: Any) -> None:
    assert record_from_json(type(record), json.loads(json.dumps(record_to_json(record)))) == record


def test_times_have_units_and_types_are_words() -> None:
    assert record_to_json(Step(1, 90, 50)) == {"servo_id": 1, "degree": 90, "interval_ms": 500}
    assert record_to_json(MACRO)["commands"] == [
        {"type": "action", "action_id": 3, "ratio_percent": 100, "loop": 1, "total_interval_ms": 0},
        {"type": "delay", "delay_ms": 500, "ratio_percent": 50, "loop": 2, "total_interval_ms": 2000},
        {"type": "macro", "macro_id": 4, "ratio_percent": 100, "loop": 1, "total_interval_ms": 0},
    ]


def test_a_command_of_no_known_type_passes_only_unchecked() -> None:
    command = MacroCommand(5, 7)
    written = record_to_json(command)
    assert (written["type"], written["type_number"], written["command_id"]) == ("other", 7, 5)
    assert record_from_json(MacroCommand, written, unchecked=True) == command
    with pytest.raises(EncodeError, match="type: must be one of action, delay, macro, not 'other'"):
        record_from_json(MacroCommand, written)


@pytest.mark.parametrize(
    ("value", "path", "text"),
    [
        ({"action_id": 1, "steps": [{"servo_id": 3}]}, "steps[0]", "'degree', 'interval_ms' are missing"),
        (
            {"action_id": 1, "steps": [{"servo_id": 300, "degree": 1, "interval_ms": 10}]},
            "steps[0].servo_id",
            "300 is outside 0..255",
        ),
        ({"action_id": "\ud800"}, "action_id", "must be an integer, not '\ufffd'"),
        ({"action_id": 1, "\ud800": 1}, "", "'\ufffd' is not a field; the fields are action_id, action_caption, steps"),
        ({"action_id": 1, "steps": ({"\ud800": 1},)}, "", "'\\ud800' is not text"),
        ([], "", "must be an object, not []"),
    ],
)
def test_an_error_names_path_and_reason(value: Any, path: str, text: str) -> None:
    with pytest.raises(EncodeError) as refused:
        record_from_json(Action, value)
    assert (refused.value.path, refused.value.text) == (path, text)
