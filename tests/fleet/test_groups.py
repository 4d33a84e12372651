"""Groups of boards in a file, and what is chosen by them."""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.errors import NotFound, ServolinkError
from servolink.fleet.groups import chosen_boards, load_groups, named_boards

GROUPS = {"front": ("rex", "fido"), "back": ("bob",)}


def written(folder: Path, text: str) -> Path:
    path = folder / "fleet.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_groups_are_read(tmp_path: Path) -> None:
    path = written(tmp_path, '[default]\nallow = "run"\n[groups]\nfront = ["rex", "fido", "rex"]\n')
    assert load_groups(path) == {"front": ("rex", "fido")}


def test_without_a_file_there_are_no_groups() -> None:
    assert load_groups() == {}


def test_a_file_that_was_named_must_exist(tmp_path: Path) -> None:
    with pytest.raises(ServolinkError, match=r"nothing\.toml does not exist"):
        load_groups(tmp_path / "nothing.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[groups\n", "line 1: is not TOML"),
        ('[groups]\n\nall = ["rex"]\n', "line 3: 'all' means every board"),
        ('[groups]\nfront = "rex"\n', "line 2: the group 'front' must be a list of names"),
        ("[groups]\nfront = [1]\n", "line 2: the group 'front' must be a list of names"),
        ("groups = 1\n", "groups must be a table"),
    ],
)
def test_a_damaged_file_is_named_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ServolinkError, match=message):
        load_groups(written(tmp_path, text))


@pytest.mark.parametrize(
    ("words", "chosen"),
    [
        ("all", ("rex", "tom")),
        ("front", ("rex", "fido")),
        ("tom,front", ("tom", "rex", "fido")),
        (["tom", "back"], ("tom", "bob")),
        ("bob", ("bob",)),
        (" rex , rex ", ("rex",)),
    ],
)
def test_boards_are_chosen_by_name_and_group(words: str | list[str], chosen: tuple[str, ...]) -> None:
    assert chosen_boards(words, ("rex", "tom"), GROUPS) == chosen


def test_a_board_that_is_away_may_be_named_and_all_are_those_that_are_there() -> None:
    assert chosen_boards("tom", ("rex",), GROUPS, ["rex", "tom"]) == ("tom",)
    assert chosen_boards("all", ("rex",), GROUPS, ["rex", "tom"]) == ("rex",)


def test_what_is_neither_board_nor_group_is_refused() -> None:
    with pytest.raises(NotFound, match="'rax' is neither a board nor a group; boards: rex; groups: front, back"):
        chosen_boards("rax", ("rex",), GROUPS)


@pytest.mark.parametrize(
    ("words", "named"),
    [("front", ("rex", "fido")), ("front, bob,rex", ("rex", "fido", "bob")), (["bob", "front,all"], None), ("", ())],
)
def test_boards_are_named_by_groups_whether_known_or_not(words: str | list[str], named: tuple[str, ...] | None) -> None:
    assert named_boards(words, GROUPS) == named


def test_nobody_at_all_is_refused() -> None:
    with pytest.raises(NotFound, match="no board was chosen; boards: none"):
        chosen_boards("all", (), {})
