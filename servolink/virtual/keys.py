"""The keyboard as a joystick: a digit presses that button, `l` before it makes it a long press."""

from __future__ import annotations

from servolink.virtual.script import ButtonChange, presses

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
