"""The channels of a recording as tables for spreadsheets, a row for each message, or for each servo in it."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec

from servolink.errors import RecordingError
from servolink.escaping import escape
from servolink.files import reason
from servolink.recorder.channels import CHANNELS, Message, ServosRead, ServoState
from servolink.recorder.reading import Entry

_FIRST = ("seconds", "time_ns")
_FORMULA = tuple("=+-@|%\t\r'")


def columns(topic: str) -> tuple[str, ...]:
    """Return the names of the columns of a channel."""
    if topic == "/servos":  # without captions, as in the file of `servolink watch`
        return (*_FIRST, *(name for name in ServoState.__struct_fields__ if name != "caption"), "missed")
    return (*_FIRST, *("took_seconds" if name in _FIRST else name for name in CHANNELS[topic].__struct_fields__))


def rows(entry: Entry) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of one message; their values are safe in a spreadsheet."""
    first = f"{entry.seconds:.6f}", entry.time
    for values in _values(entry.message):
        yield (*first, *map(_cell, values))


def write_tables(entries: Iterable[Entry], path_of: Callable[[str], Path], *, replace: bool = False) -> dict[Path, int]:
    """Write a CSV file for each channel of `entries`, where `path_of` its name says; return their rows.

    Raise RecordingError if a file exists and `replace` is not set, or cannot be written; what was begun is removed.
    """
    written: dict[Path, int] = {}
    try:
        with ExitStack() as files:
            tables: dict[str, Any] = {}
            for entry in entries:
                path = path_of(entry.topic.removeprefix("/"))
                if entry.topic not in tables:
                    file = files.enter_context(path.open("w" if replace else "x", encoding="utf-8", newline=""))
                    written[path] = 0
                    tables[entry.topic] = csv.writer(file, lineterminator="\n")
                    tables[entry.topic].writerow(columns(entry.topic))
                for row in rows(entry):
                    tables[entry.topic].writerow(row)
                    written[path] += 1
    except BaseException as error:
        for path in written:
            path.unlink(missing_ok=True)
        if isinstance(error, FileExistsError):
            raise RecordingError(f"{error.filename} exists already; --force replaces it") from error
        if isinstance(error, (OSError, ValueError)) and not isinstance(error, RecordingError):
            raise RecordingError(f"the table cannot be written: {reason(error)}") from error
        raise
    return written


def _values(message: Message) -> Iterator[list[Any]]:
    if isinstance(message, ServosRead):
        for servo in message.servos:
            yield [getattr(servo, name) for name in servo.__struct_fields__ if name != "caption"] + [message.missed]
    else:
        yield list(msgspec.structs.astuple(message))


def _cell(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, dict):
        return json.dumps(value)
    if isinstance(value, str):
        text = escape(value)  # what begins like a formula would be run as one
        return f"'{text}" if text.startswith(_FORMULA) else text
    return value
