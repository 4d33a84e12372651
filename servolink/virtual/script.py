"""Button presses written as text: `1.5 press 3`, one a line, seconds since the start, word, button id.

`press` goes down and up again, `long` stays down long enough for a long press, `down` and `up` are one half.
Empty lines and what follows a `#` are skipped.
"""

from __future__ import annotations

from typing import NamedTuple

from servolink.printable import printable
from servolink.virtual.buttons import LONG_PRESS_AFTER

SHORT = 0.1
"""Seconds that `press` keeps the button down."""
LONG = LONG_PRESS_AFTER + 0.4
"""Seconds that `long` keeps the button down."""

_HIGHEST_ID = 0xFFFF_FFFF
_LONGEST = 1e6
_WORDS = {"press": SHORT, "long": LONG, "down": None, "up": None}


class ButtonChange(NamedTuple):
    """A button goes down or up."""

    at: float
    button_id: int
    down: bool


def presses(at: float, word: str, button_id: int) -> list[ButtonChange]:
    """Return the changes that `word` stands for; KeyError for an unknown word."""
    held = _WORDS[word]
    if held is None:
        return [ButtonChange(at, button_id, down=word == "down")]
    return [ButtonChange(at, button_id, down=True), ButtonChange(at + held, button_id, down=False)]


def parse_script(text: str) -> list[ButtonChange]:
    """Return the changes in order of time; ValueError names the line that is none."""
    changes: list[ButtonChange] = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        if words:
            changes += _line(number, words)
    return sorted(changes)


def _line(number: int, words: list[str]) -> list[ButtonChange]:
    try:
        at, word, button = words
        changes = presses(float(at), word, int(button))
    except (ValueError, KeyError):
        raise ValueError(
            f"line {number}: {printable(' '.join(words))!r} is not like '1.5 press 3' ({', '.join(_WORDS)})"
        ) from None
    if not (0 <= changes[0].at <= _LONGEST and 0 <= changes[0].button_id <= _HIGHEST_ID):
        raise ValueError(f"line {number}: time or button id is out of range")
    return changes
