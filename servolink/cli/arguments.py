"""What may be typed as the value of an option; argparse makes wrong usage of the rest."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable

_WHOLE = re.compile(r"[+-]?[0-9]{1,20}", re.ASCII)


def not_empty(text: str) -> str:
    """Read a name that must not be empty, as from a variable of a shell that was never set."""
    if not text:
        raise argparse.ArgumentTypeError("it is empty; leave it out, or say which")
    return text


def caption_encoding(text: str) -> str:
    """Read the name of an encoding in which captions can be written."""
    from servolink.protocol.caption import check_encoding  # help needs none of the protocol

    try:
        return check_encoding(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """Return what reads a whole number in ASCII digits."""

    def read(text: str) -> int:
        if not _WHOLE.fullmatch(text) or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number from {low} to {high}")
        return int(text)

    return read


def number(low: float, high: float, unit: str) -> Callable[[str], float]:
    """Return what reads a number of so many of `unit`."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:  # as is the case for nan
            raise argparse.ArgumentTypeError(f"{text!r} is outside {low:g}..{high:g} {unit}")
        return value

    return read


speed = number(0.001, 100_000, "degrees per second")
