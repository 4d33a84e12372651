"""Scripts of a person's actions on a board, as text with one event in each line.

`1.5 press 3` presses button 3 for a moment, 1.5 seconds after the start. `long` is a long press; `down` and `up` are
the two halves of a press. `2.0 push 1 45` turns servo 1, which must be released, to 45 degrees by hand. `3.0 power`
switches the board off and on. Empty lines and text after a `#` are skipped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, NamedTuple, TypeAlias

from servolink.errors import quote
from servolink.virtual.board import VirtualBoard
from servolink.virtual.buttons import LONG_PRESS_AFTER
from servolink.virtual.hardware import Hardware

SHORT = 0.1
"""Duration of `press`, in seconds."""
LONG = LONG_PRESS_AFTER + 0.4
"""Duration of `long`, in seconds."""

_MAX_BUTTON_ID = 0xFFFF_FFFF
_MAX_SECONDS = 1e6
_WORDS = {"press": SHORT, "long": LONG, "down": None, "up": None}


class ButtonChange(NamedTuple):
    """Press or release of a button at the time `at`, in seconds."""

    at: float
    button_id: int
    down: bool

    def apply(self, board: VirtualBoard, now: float) -> None:
        """Let it happen on the board at the time `now`."""
        (board.press_button if self.down else board.release_button)(self.button_id, now)


class Push(NamedTuple):
    """Turn of a servo by hand at the time `at`, in seconds."""

    at: float
    servo_id: int
    degree: int

    def apply(self, board: VirtualBoard, now: float) -> None:
        """Let it happen on the board at the time `now`."""
        board.push_servo(self.servo_id, self.degree, now)


class PowerCycle(NamedTuple):
    """Interruption of the power at the time `at`, in seconds."""

    at: float

    def apply(self, board: VirtualBoard, now: float) -> None:
        """Let it happen on the board at the time `now`."""
        board.power_cycle(now)


Event: TypeAlias = ButtonChange | Push | PowerCycle


def presses(at: float, word: str, button_id: int) -> list[ButtonChange]:
    """Return the button changes for `word`. Raise KeyError for an unknown word."""
    held = _WORDS[word]
    if held is None:
        return [ButtonChange(at, button_id, down=word == "down")]
    return [ButtonChange(at, button_id, down=True), ButtonChange(at + held, button_id, down=False)]


def parse_script(text: str) -> list[Event]:
    """Return the events of a script in order of time. Raise ValueError with the number of a wrong line."""
    events: list[Event] = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        if words:
            events += _line(number, words)
    return sorted(events, key=tuple)


def _line(number: int, words: list[str]) -> Sequence[Event]:
    try:
        events, highest = _events(words)
    except (ValueError, KeyError):
        raise ValueError(
            f"line {number}: {quote(' '.join(words))} must be like '1.5 press 3' ({', '.join(_WORDS)}), "
            "'2.0 push 1 45' or '3.0 power'"
        ) from None
    if not (0 <= events[0].at <= _MAX_SECONDS and all(0 <= each <= highest for each in events[0][1:2])):
        limits = f"the time must be 0..{_MAX_SECONDS:.0f} s, the id 0..{highest}"
        raise ValueError(f"line {number}: {quote(' '.join(words))} is out of range; {limits}")
    return events


def _events(words: list[str]) -> tuple[Sequence[Event], int]:
    """Return the events of a line, and the highest allowed id."""
    if words[1:] == ["power"]:
        return [PowerCycle(float(words[0]))], 0
    if len(words) > 1 and words[1] == "push":
        at, _, servo_id, degree = words
        return [Push(float(at), int(servo_id), int(degree))], Hardware.MAX_SERVOS
    at, word, button = words
    return presses(float(at), word, int(button)), _MAX_BUTTON_ID


class Keys:
    """Converter of typed characters into events."""

    HELP: ClassVar[str] = "keys: 0-9 press a button, l then 0-9 make a long press, p switches off and on, Ctrl-C ends"

    def __init__(self) -> None:
        """Start without a typed `l`."""
        self._word = "press"

    def typed(self, text: str) -> list[Event]:
        """Return the events for the keys in `text`, in seconds from now; other keys have no effect."""
        events: list[Event] = []
        for key in text:
            if key in "0123456789":
                events += presses(0.0, self._word, int(key))
            elif key == "p":
                events.append(PowerCycle(0.0))
            self._word = "long" if key == "l" else "press"
        return events
