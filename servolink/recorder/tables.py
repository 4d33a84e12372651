"""Tables of the channels of a recording, for spreadsheets: a row for each message, or for each servo of a message."""

from __future__ import annotations

import codecs
import csv
import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO

from servolink.errors import escape
from servolink.recorder.channels import CHANNELS, Message, columns, rows
from servolink.recorder.new_file import naming, new_file
from servolink.recorder.reading import Entry

_UTF_8 = codecs.getwriter("utf-8")
_FORMULA = tuple("=+-@|%\t\r'")


def cells(entry: Entry[Message]) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of a message, with values safe in a spreadsheet."""
    for seconds, time, *values in rows(entry.seconds, entry.time, entry.message):
        yield f"{seconds:.6f}", time, *map(_cell, values)


def write_tables(
    entries: Iterable[Entry[Message]], path_of: Callable[[str], Path], *, replace: bool = False
) -> dict[Path, int]:
    """Write a CSV file for each channel of `entries`, at the path from `path_of`; return the numbers of rows.

    Raise RecordingError if a file exists and `replace` is not set, or cannot be written; then no file is changed,
    except for a fault in the last step, where the files are replaced in turn.
    """
    tables: dict[str, _ChannelTable] = {}
    with ExitStack() as files:
        for entry in entries:
            if entry.topic not in tables:
                path = path_of(entry.topic.removeprefix("/"))
                tables[entry.topic] = _ChannelTable(
                    path, files.enter_context(new_file(path, replace=replace)), entry.topic
                )
            tables[entry.topic].add(entry)
        for table in tables.values():  # the disk may be full: before the first replacement
            table.flush()
    return {table.path: table.count for table in tables.values()}


class _ChannelTable:
    """Table of a channel during the writing."""

    def __init__(self, path: Path, file: BinaryIO, topic: str) -> None:
        self.path = path
        self.count = 0
        """Number of rows so far."""
        self._file = file
        self._writer = csv.writer(_UTF_8(file), lineterminator="\n")
        self._writer.writerow(columns(CHANNELS[topic]))

    def add(self, entry: Entry[Message]) -> None:
        """Write the rows of a message. Raise RecordingError, with the name of the file, for a fault of the disk."""
        with naming(self.path):
            for row in cells(entry):
                self._writer.writerow(row)
                self.count += 1

    def flush(self) -> None:
        """Pass all rows on to the system. Raise RecordingError, with the name of the file, for a fault of the disk."""
        with naming(self.path):
            self._file.flush()


def _cell(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, dict):
        return json.dumps(value)
    if isinstance(value, str):
        text = escape(value)  # texts with the beginning of a formula would be run as a formula
        return f"'{text}" if text.startswith(_FORMULA) else text
    return value
