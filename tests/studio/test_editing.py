"""What the page does to records: differences between projects, and captions."""

from __future__ import annotations

from typing import Any

from tests.studio.web_code import call_all, needs_node

pytestmark = needs_node

_EMPTY: dict[str, Any] = {
    "servo_parameters": [],
    "actions": [],
    "macros": [],
    "joystick_tables": [],
    "active_joystick_table": None,
}


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
