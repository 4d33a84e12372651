"""Keys that press buttons."""

from __future__ import annotations

from servolink.virtual.board_script import Keys, PowerCycle, presses


def test_a_digit_presses_its_button() -> None:
    assert Keys().typed("3") == presses(0.0, "press", 3)


def test_l_makes_the_next_one_long_and_only_that() -> None:
    keys = Keys()
    assert keys.typed("l") == []
    assert keys.typed("40") == presses(0.0, "long", 4) + presses(0.0, "press", 0)


def test_p_switches_off_and_on() -> None:
    assert Keys().typed("p3") == [PowerCycle(0.0), *presses(0.0, "press", 3)]


def test_other_keys_do_nothing_and_take_back_the_l() -> None:
    assert Keys().typed("lx\n\x1b٣3") == presses(0.0, "press", 3)
