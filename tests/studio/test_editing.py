"""What the page does to records is what the package does to them: mirroring, times that suffice, differences."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from servolink.project import Mirror, other_side, partners_by_caption
from servolink.protocol import ServoParameter, Step
from servolink.studio.static_files import page_files
from tests.studio.web_code import call_all, needs_node

pytestmark = needs_node

_HOSTILE = Path(__file__).parents[1] / "data/hostile_texts.json"
_CAPTIONS = [
    "L arm",
    "l_knee",
    "knee-R",
    "L2",
    "LKnee",
    "kneeL",
    "Left foot",
    "RIGHT",
    "rIght",
    "左臂",
    "右2",
    "lift",
    "Roll",
    "",
    "arm",
]
_EMPTY: dict[str, Any] = {
    "servo_parameters": [],
    "actions": [],
    "macros": [],
    "joystick_tables": [],
    "active_joystick_table": None,
}


def hostile_captions() -> list[str]:
    found: list[str] = []

    def collect(value: Any) -> None:
        if isinstance(value, str):
            found.append(value)
        elif isinstance(value, list | dict):
            for each in value.values() if isinstance(value, dict) else value:
                collect(each)

    collect(json.loads(_HOSTILE.read_text(encoding="utf-8")))
    return found


def test_the_other_side_is_that_of_the_package() -> None:
    captions = _CAPTIONS + hostile_captions()
    found = call_all([("state/mirror.js", "otherSide", [caption]) for caption in captions])
    assert found == list(map(other_side, captions))


def step_form(servo_id: int, degree: int, interval: int) -> dict[str, int]:
    return {"servo_id": servo_id, "degree": degree, "interval_ms": interval * 10}


def test_captions_are_mirrored_as_by_the_package() -> None:
    captions = {1: "L arm", 2: "R arm", 3: "head", 4: "r knee", 5: "L knee"}
    parameters = [ServoParameter(servo_id, 0, caption) for servo_id, caption in captions.items()]
    steps = [Step(1, 30, 50), Step(3, 5, 20), Step(4, -7, 10)]
    mirror = Mirror(partners_by_caption(parameters, captions))
    expected = [step_form(*map(int, (one.servo_id, one.degree, one.interval))) for one in map(mirror.step, steps)]
    forms = [{"servo_id": one.servo_id, "servo_caption": one.servo_caption} for one in parameters]
    assert mirrored(None, forms, [step_form(one.servo_id, one.degree, one.interval) for one in steps]) == expected


def mirrored(figure: Any, parameters: list[Any], steps: list[Any]) -> Any:
    (found,) = call_all([("../../../tests/studio/web_mirror.js", "mirroredSteps", [figure, parameters, steps])])
    return found


def test_a_figure_is_mirrored_by_its_groups() -> None:
    figure = json.loads(page_files()["/figures/humanoid-16.figure.json"].content)
    steps = [step_form(2, 142, 60), step_form(9, 30, 40), step_form(16, 5, 10)]
    expected = [step_form(5, -142, 60), step_form(14, -30, 40), step_form(11, -5, 10)]
    assert mirrored(figure, [], steps) == expected
    assert mirrored(figure, [], expected) == steps


def test_a_figure_without_sides_leaves_it_to_the_captions() -> None:
    figure = json.loads(page_files()["/figures/arm-6.figure.json"].content)
    assert mirrored(figure, [], [step_form(1, 40, 10)]) == [step_form(1, 40, 10)]


def test_records_that_were_not_edited_are_those_of_the_board() -> None:
    def action(action_id: int, caption: str) -> dict[str, Any]:
        return {"action_id": action_id, "action_caption": caption, "steps": []}

    base = {**_EMPTY, "actions": [action(1, "a"), action(2, "b"), action(3, "c")]}
    draft = {**_EMPTY, "actions": [action(1, "mine"), action(2, "b"), action(4, "new")], "active_joystick_table": 2}
    board = {**_EMPTY, "actions": [action(1, "a"), action(2, "theirs"), action(3, "c"), action(5, "added")]}
    (found,) = call_all([("state/differences.js", "rebased", [base, draft, board])])
    assert [each["action_caption"] for each in found["actions"]] == ["mine", "theirs", "new", "added"]
    assert found["active_joystick_table"] == 2
    (changes,) = call_all([("state/differences.js", "differencesOf", [board, found])])
    assert [(each["kind"], each["id"], each["change"]) for each in changes] == [
        ("actions", 1, "changed"),
        ("actions", 3, "removed"),
        ("actions", 4, "added"),
        ("active_joystick_table", 0, "changed"),
    ]


def test_a_caption_is_cut_to_the_bytes_of_the_board() -> None:
    captions = ["a" * 40, "左" * 12, "x" * 31 + "é"]
    found = call_all([("state/records.js", "fitCaption", [caption]) for caption in captions])
    assert found == ["a" * 32, "左" * 10, "x" * 31]
