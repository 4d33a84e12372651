"""What people do to a board, written as text: `1.5 press 3`, one a line, seconds since the start, word, button id.

`press` goes down and up again, `long` stays down long enough for a long press, `down` and `up` are one half.
`2.0 push 1 45` turns servo 1, which must be limp, to 45 degrees by hand.
Empty lines and what follows a `#` are skipped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from servolink.escaping import quote
from servolink.virtual.buttons import LONG_PRESS_AFTER

SHORT = 0.1
"""Seconds that `press` keeps the button down."""
LONG = LONG_PRESS_AFTER + 0.4
"""Seconds that `long` keeps the button down."""

_HIGHEST_ID = 0xFFFF_FFFF
_MAX_SERVOS = 254
_LONGEST = 1e6
_WORDS = {"press": SHORT, "long": LONG, "down": None, "up": None}


class ButtonChange(NamedTuple):
    """A button goes down or up."""

    at: float
    button_id: int
    down: bool


class Push(NamedTuple):
    """A servo is turned by hand."""

    at: float
    servo_id: int
    degree: int


Deed = ButtonChange | Push


def presses(at: float, word: str, button_id: int) -> list[ButtonChange]:
    """Return the changes that `word` stands for; KeyError for an unknown word."""
    held = _WORDS[word]
    if held is None:
        return [ButtonChange(at, button_id, down=word == "down")]
    return [ButtonChange(at, button_id, down=True), ButtonChange(at + held, button_id, down=False)]


def parse_script(text: str) -> list[Deed]:
    """Return what is done in order of time; ValueError names the line that says nothing."""
    deeds: list[Deed] = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        if words:
            deeds += _line(number, words)
    return sorted(deeds, key=tuple)


def _line(number: int, words: list[str]) -> Sequence[Deed]:
    try:
        deeds, highest = _deeds(words)
    except (ValueError, KeyError):
        raise ValueError(
            f"line {number}: {quote(' '.join(words))} must be like '1.5 press 3' ({', '.join(_WORDS)}) "
            "or '2.0 push 1 45'"
        ) from None
    if not (0 <= deeds[0].at <= _LONGEST and 0 <= deeds[0][1] <= highest):
        raise ValueError(f"line {number}: time or id is out of range")
    return deeds


def _deeds(words: list[str]) -> tuple[Sequence[Deed], int]:
    """Return what a line says, and the highest id that it may name."""
    if len(words) > 1 and words[1] == "push":
        at, _, servo_id, degree = words
        return [Push(float(at), int(servo_id), int(degree))], _MAX_SERVOS
    at, word, button = words
    return presses(float(at), word, int(button)), _HIGHEST_ID


HELP = "keys: 0-9 press that button, l then 0-9 hold it for a long press, Ctrl-C ends"


class Keys:
    """Turns typed characters into button changes."""

    def __init__(self) -> None:
        """Begin with no `l` typed."""
        self._word = "press"

    def typed(self, text: str) -> list[ButtonChange]:
        """Return what `text` does, in seconds from now; other keys do nothing."""
        changes: list[ButtonChange] = []
        for key in text:
            if key in "0123456789":
                changes += presses(0.0, self._word, int(key))
            self._word = "long" if key == "l" else "press"
        return changes
