"""The table of `servolink fleet watch` fits the terminal."""

from __future__ import annotations

from typing import Any

from servolink.cli.fleet.fleet_watch import picture
from servolink.fleet import BoardNow, BoardSeen


def board_seen(name: str, *, is_online: bool = True, **known: Any) -> BoardSeen:
    given: dict[str, Any] = {"connection": "connected", "allow": "run", **known}
    now = BoardNow(board=name, host="here", version="1", at=0.0, **given)
    return BoardSeen(name, is_online, now)


def test_the_table_fits_and_shows_first_what_needs_a_look() -> None:
    there = [
        *(board_seen(f"board{number}") for number in range(40)),
        board_seen("away", is_online=False),
        board_seen("low", battery_percent=5.0, lease="a program with a very long name \u202e that moves it"),
        board_seen("lost", connection="lost", problems=("the cable is out",) * 9),
    ]
    for width, height in ((80, 24), (20, 8), (200, 60)):
        lines = picture(there, width, height)
        assert len(lines) <= height
        assert all(len(text) <= width for text, _ in lines)
    texts = [text for text, _ in picture(there, 80, 24)]
    assert texts[0] == "43 boards, 42 connected"
    assert [text.split()[0] for text in texts[3:6]] == ["lost", "low", "board0"]
    assert "and 4 problems more" in texts
