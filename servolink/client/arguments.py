"""Checks of what a program gives: a wrong value is told at once, not by what comes of it later."""

from __future__ import annotations

from typing import TypeGuard

from servolink.errors import EncodeError
from servolink.printable import shown

_LONGEST = 3600  # a cancelled request keeps its turn so long, and a stop is read back only then
_MOST = 1_000


def is_number(value: object) -> TypeGuard[float]:
    """Tell whether `value` is a number; True and False are none."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def check_timeout(value: object) -> None:
    """Raise TypeError or ValueError if `value` is no time for an answer: 0.001..3600 seconds."""
    if not is_number(value):
        raise TypeError(f"timeout: {shown(value)} is no number of seconds")
    if not 0.001 <= value <= _LONGEST:
        raise ValueError(f"timeout: {shown(value)} is outside 0.001..{_LONGEST} seconds")


def check_count(name: str, value: object, least: int) -> None:
    """Raise TypeError or ValueError if `value` is no whole number `least`..1000."""
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{name}: {shown(value)} is no whole number")
    if not least <= value <= _MOST:
        raise ValueError(f"{name}: {shown(value)} is outside {least}..{_MOST}")


def flag(name: str, value: object) -> int:
    """Return 1 for True and 0 for False; EncodeError for what is neither."""
    if not isinstance(value, int) or value not in {0, 1}:
        raise EncodeError(f"{name}: {shown(value)} is neither True nor False")
    return int(value)
