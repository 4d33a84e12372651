"""Checks of numbers passed by programs; numbers of other libraries, such as NumPy, become Python numbers."""

from __future__ import annotations

from numbers import Real
from operator import index
from typing import Any, TypeGuard

from servolink.errors import EncodeError, quote

SECONDS = (0.001, 3600.0)
"""Shortest and longest time to wait for a response, in seconds."""


def as_number(value: Any) -> Any:
    """Return a number as an int or a float, any other value, including bools and angles, unchanged."""
    if value is None or isinstance(value, int | str):
        return value
    if isinstance(value, float):
        return float(value)  # a subclass of float becomes a plain float
    try:
        return index(value)
    except TypeError:
        return float(value) if isinstance(value, Real) else value


def is_number(value: object) -> TypeGuard[float]:
    """Return whether `value` is an int or a float; bools do not count as numbers."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def is_integer(value: object) -> TypeGuard[int]:
    """Return whether `value` is an int; bools do not count as numbers."""
    return isinstance(value, int) and not isinstance(value, bool)


def check_seconds(name: str, value: object) -> None:
    """Raise TypeError or ValueError if `value`, of the argument `name`, is not a number of 0.001..3600 seconds."""
    if not is_number(value):
        raise TypeError(f"{name} must be a number of seconds, not {quote(value)}")
    least, most = SECONDS
    if not least <= value <= most:
        raise ValueError(f"{name} must be {least:g}..{most:g} seconds, not {quote(value)}")


def checked_servo_id(where: str, servo_id: object) -> int:
    """Return `servo_id`. Raise EncodeError, with a text beginning with `where`, for values outside 0..254."""
    servo_id = as_number(servo_id)
    if not is_integer(servo_id) or not 0 <= servo_id <= 0xFE:
        raise EncodeError(f"{where}: servo id {quote(servo_id)} is outside 0..254")
    return servo_id
