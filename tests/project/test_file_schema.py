"""The JSON Schema that is shipped."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any

import msgspec

from servolink.project import blocks
from servolink.project.figure import BodyFields, Feet, Figure, FixedBase, Joint, ServoMeasured, Shape, View
from servolink.project.project_file import ProjectFile
from tests.project.test_file import ROBOT

_BLOCKS = [part for part in vars(blocks).values() if isinstance(part, type) and part.__module__ == blocks.__name__]
_BESIDE = {
    field.encode_name
    for part in (BodyFields, Feet, Figure, FixedBase, Joint, ServoMeasured, Shape, View, *_BLOCKS)
    for field in msgspec.structs.fields(part)
} - {"servo_id", "degree", "interval_ms", "delay_ms", "ratio_percent", "loop", "button_id"} | {"mode", "type"}
"""Fields of the figure and of the blocks, unless the records have them too."""


def test_the_shipped_schema_is_that_of_the_types() -> None:
    """If not: write `ProjectFile.schema_text()` there."""
    shipped = files("servolink.project") / "servolink-project.schema.json"
    assert shipped.read_text(encoding="utf-8") == ProjectFile.schema_text()


def test_it_describes_each_field_of_a_file_and_no_other() -> None:
    described = json.loads(ProjectFile.schema_text())["$defs"]
    fields = {key for part in described.values() for key in part["properties"]} - _BESIDE
    assert all(not part["additionalProperties"] for part in described.values())
    records = set(_keys(json.loads(ProjectFile(ROBOT, unchecked=True).text())))
    assert fields - {"$schema"} == records - {"type"}


def test_it_says_what_a_step_can_be() -> None:
    step = json.loads(ProjectFile.schema_text())["$defs"]["Step"]
    assert step["required"] == ["servo_id", "degree", "interval_ms"]
    interval = {"description": "time, ms", "type": "integer", "minimum": 0, "maximum": 327670, "multipleOf": 10}
    assert step["properties"]["interval_ms"] == interval


def _keys(value: Any) -> list[str]:
    """Return the names of all fields in a file, however deep."""
    if isinstance(value, dict):
        return [*value, *(key for part in value.values() for key in _keys(part))]
    return [key for part in value for key in _keys(part)] if isinstance(value, list) else []
