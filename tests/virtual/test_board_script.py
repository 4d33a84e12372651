"""Button presses written as text."""

from __future__ import annotations

import pytest

from servolink.virtual.board_script import ButtonChange, PowerCycle, Push, parse_script, presses
from servolink.virtual.buttons import LONG_PRESS_AFTER


def test_words_become_changes_in_order_of_time() -> None:
    script = """
    # a comment
    2.0 down 7
    1.5 press 3   # with a comment

    4 up 7
    """
    changes = parse_script(script)
    assert [change[1:] for change in changes] == [(3, True), (3, False), (7, True), (7, False)]
    assert [change.at for change in changes] == sorted(change.at for change in changes)
    assert changes[0] == ButtonChange(1.5, 3, True)
    assert changes[3] == ButtonChange(4.0, 7, False)


def test_press_is_short_and_long_is_long() -> None:
    down, up = parse_script("1 press 3")
    assert 0 < up.at - down.at < LONG_PRESS_AFTER
    down, up = parse_script("1 long 3")
    assert up.at - down.at > LONG_PRESS_AFTER


def test_up_comes_before_down_at_the_same_time() -> None:
    changes = parse_script("1 down 3\n2 down 3\n2 up 3")
    assert [isinstance(change, ButtonChange) and change.down for change in changes] == [True, False, True]


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("1 push 3", "must be like"),
        ("press 3", "must be like"),
        ("x press 3", "must be like"),
        ("1 press y", "must be like"),
        ("1 press 3 4", "must be like"),
        ("-1 press 3", "out of range"),
        ("nan press 3", "out of range"),
        ("inf press 3", "out of range"),
        ("1 press -1", "out of range"),
        ("1 press 4294967296", "out of range"),
    ],
)
def test_other_lines_are_refused_by_number(line: str, text: str) -> None:
    with pytest.raises(ValueError, match=f"^line 2: .*{text}"):
        parse_script(f"1 press 3\n{line}\n")


def test_a_servo_is_pushed() -> None:
    assert parse_script("2.0 push 1 -45  # by hand\n1 press 3") == [
        ButtonChange(1.0, 3, down=True),
        ButtonChange(1.1, 3, down=False),
        Push(2.0, 1, -45),
    ]


def test_the_power_is_switched_off_and_on() -> None:
    assert parse_script("3 power\n1 press 3") == [*presses(1.0, "press", 3), PowerCycle(3.0)]


@pytest.mark.parametrize("line", ["-1 power", "1 power 3", "x power", "nan power", "1 powers"])
def test_a_power_cycle_that_is_none_is_named(line: str) -> None:
    with pytest.raises(ValueError, match="line 1: "):
        parse_script(line)


@pytest.mark.parametrize("line", ["1 push 1", "1 push 255 3", "1 push 1 2.5", "-1 push 1 2", "1 push x 2"])
def test_a_push_that_is_none_is_named(line: str) -> None:
    with pytest.raises(ValueError, match="line 1: "):
        parse_script(line)
