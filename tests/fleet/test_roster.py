"""What a program keeps of a fleet is bounded, whatever others write at the broker."""

from __future__ import annotations

import pytest

from servolink.fleet import roster as module
from servolink.fleet.roster import Roster


def test_messages_of_all_boards_together_are_bounded_and_boards_still_come_and_go(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "MOST_HELD", 1000)
    roster = Roster()
    for number in range(5):
        roster.take(f"b{number}", "servos", bytes(300), 0.0)
        roster.take(f"b{number}", "available", b"online", 0.0)
    assert roster.refused == 2
    assert sorted(roster.online) == ["b0", "b1", "b2", "b3", "b4"]
    for _ in range(9):  # in place of the message before
        roster.take("b0", "servos", bytes(400), 0.0)
    assert roster.refused == 2
    roster.take("b1", "log", bytes(1), 0.0)
    assert roster.refused == 3
    roster.take("b0", "available", b"", 0.0)
    roster.take("b1", "servos", bytes(700), 0.0)
    assert roster.refused == 3
    assert sorted(roster.online) == ["b1", "b2", "b3", "b4"]
