"""Tables as aligned text."""

from __future__ import annotations

from servolink.cli.output import Table, plain_lines


def test_numbers_stand_to_the_right_and_texts_to_the_left() -> None:
    table = Table(("servo", "name", "ok"), [(1, "a", True), (100, "longer", False)])
    assert plain_lines(table) == ["servo  name    ok", "    1  a       yes", "  100  longer  no"]


def test_what_is_missing_is_left_out() -> None:
    assert plain_lines(Table(("a", "b"), [(None, 1), ("x", None)])) == ["a  b", "   1", "x"]


def test_facts_have_no_head() -> None:
    assert plain_lines(Table((), [("url", "x"), ("servos", 16)])) == ["url     x", "servos  16"]


def test_wide_and_combining_characters_take_their_place() -> None:
    lines = plain_lines(Table(("caption", "id"), [("機器人", 1), ("e\u0301te\u0301", 2), ("plain", 3)]))
    assert lines == ["caption  id", "機器人    1", "e\u0301te\u0301       2", "plain     3"]


def test_titles_and_cells_are_made_safe() -> None:
    lines = plain_lines(Table(("caption",), [("\x1b[2J",)], "table \u202e"))
    assert lines == ["table \\u202e", "caption", "\\x1b[2J"]
    assert plain_lines(Table((), [], "only \x07")) == ["only \\x07"]
