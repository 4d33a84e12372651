"""Types of option values, for argparse, which makes a wrong value a usage error."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from typing import TYPE_CHECKING

from servolink.cli.command import Option, option
from servolink.errors import TransportUnavailable, quote
from servolink.support import ALL, is_name

if TYPE_CHECKING:
    from pathlib import Path

LAST_SERVO = 254  # 255 means all

_WHOLE = re.compile(r"[+-]?[0-9]{1,20}", re.ASCII)


def not_empty(text: str) -> str:
    """Return `text`, which must not be empty, as after the expansion of an unset shell variable."""
    if not text:
        raise argparse.ArgumentTypeError("must not be empty; give a value or leave the option out")
    return text


def file_path(text: str) -> Path:
    """Return `text` as a path; an empty path would mean the current folder."""
    from pathlib import Path  # late: the help uses no path

    return Path(not_empty(text))


def new_file(text: str) -> Path:
    """Return the path of a file to write."""
    if text == "-":
        raise argparse.ArgumentTypeError("must name a file; standard output is none (./- is a file)")
    return file_path(text)


def caption_encoding(text: str) -> str:
    """Return `text` if it names an encoding for captions."""
    from servolink.protocol import Codec  # late: the help needs no protocol

    try:
        return Codec(caption_encoding=text).caption_encoding
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def board_name(text: str) -> str:
    """Return `text` if it can be the name of a board."""
    if not is_name(text):
        raise argparse.ArgumentTypeError(f"{quote(text)} cannot be a name: use up to 64 letters, digits, - and _")
    if text == ALL:
        raise argparse.ArgumentTypeError(f"{quote(text)} means every board of a fleet: choose another name")
    return text


def listening(text: str) -> str:
    """Return `text` if it is HOST:PORT."""
    from servolink.transports import NetworkPlace  # late: most commands serve nobody

    try:
        NetworkPlace.parse(text)
    except TransportUnavailable as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """Return a type for integers from `low` to `high`, in ASCII digits."""

    def read(text: str) -> int:
        if not _WHOLE.fullmatch(text) or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"must be an integer from {low} to {high}, not {quote(text)}")
        return int(text)

    return read


def number(low: float, high: float, unit: str) -> Callable[[str], float]:
    """Return a type for numbers of `unit` from `low` to `high`."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:  # false for nan
            raise argparse.ArgumentTypeError(f"must be from {low:g} to {high:g} {unit}, not {quote(text)}")
        return value

    return read


def timeout(help: str) -> Option:  # noqa: A002 - as argparse calls it
    """Return the option `--timeout`."""
    return option("--timeout", "SECONDS", help, number(0.001, 3600, "seconds"))


def or_caption(read_id: Callable[[str], int]) -> Callable[[str], int | str]:
    """Return a type for ids, read by `read_id`, and for captions, which are everything but a number."""

    def read(text: str) -> int | str:
        return read_id(text) if _WHOLE.fullmatch(text) else not_empty(text)

    return read


SPEED = number(0.001, 100_000, "degrees per second")
RECORD_ID = whole_number(1, 2**31 - 1)
SERVO_ID = whole_number(0, LAST_SERVO)
RECORD_NAME = or_caption(RECORD_ID)
SERVO_NAME = or_caption(SERVO_ID)

MOST_TRIM = 180
"""Degrees of the largest angle correction that is stored, to both sides."""


def alarm(text: str) -> str:
    """Return `text` if it describes an alarm."""
    from servolink.client import Alarm

    try:
        Alarm.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text
