"""Numbers of other libraries, such as NumPy, as Python's own: for everything that takes a number from a program."""

from __future__ import annotations

from operator import index
from typing import Any


def as_number(value: Any) -> Any:
    """Return a number as an int or a float. Anything else, bools and angles too, is returned as it is."""
    if value is None or isinstance(value, int | str):
        return value
    if isinstance(value, float):
        return float(value)  # also if its type is derived from float
    try:
        return index(value)
    except TypeError:
        from numbers import Real  # late: most numbers are Python's

        return float(value) if isinstance(value, Real) else value
