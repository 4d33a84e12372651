"""Output of commands: tables and text for people, JSON for programs, errors and the log.

Text from outside (a board, a file, the system) is escaped here and nowhere else in the command line.
"""

from __future__ import annotations

import codecs
import errno
import json
import logging
import os
import sys
import unicodedata
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import zip_longest
from textwrap import wrap
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from servolink.errors import EncodeError, Reason, RequestError, ServolinkError, TargetNotReached, escape
from servolink.motion import Adc, Angle, Degrees

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as RichTable


class Form:
    """Form of the output of this process."""

    json: ClassVar[bool] = False
    """Whether programs read it: then nothing is drawn, and nothing is asked."""


_UNWRITABLE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF}


def open_missing_stderr() -> None:
    """Replace a closed standard error: `print` would take its absence for standard output."""
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - stays open


def flush_stdout() -> None:
    """Write the buffered text of standard output."""
    if sys.stdout is not None:
        sys.stdout.flush()


def flush_stderr() -> None:
    """Flush standard error, and silence a broken stream: argparse prints without checking the result."""
    try:
        sys.stderr.flush()
    except OSError:
        silence(2)


def print_error(text: str) -> None:
    """Print a line on standard error, if it can be written."""
    try:
        print(escape(text), file=sys.stderr, flush=True)
    except OSError:
        silence(2)


def fail(error: Exception, code: int, *, kind: str = "", text: str = "") -> int:
    """Print an error as a line of text, or as one JSON object for programs, and return the exit code `code`.

    `kind` and `text` replace the class and the text of the error.
    """
    text = text or str(error)
    if Form.json:
        print_json_error(kind or _kind(error), text, **_details(error))
    else:
        print_error(f"servolink: {text}")
    return code


def print_json_error(kind: str, text: str, **details: object) -> None:
    """Print an error on standard error as one JSON object on one line of ASCII; empty details are left out."""
    message = "\n".join(map(escape, text.split("\n")))
    given = {name: value for name, value in details.items() if value}
    print_error(json.dumps({"error": {"kind": kind, "message": message, **given}}))


def _kind(error: Exception) -> str:
    """Return the name of the nearest public class of an error: of `servolink.errors`, or built in."""
    public = (ServolinkError.__module__, OSError.__module__)
    return next(each.__name__ for each in type(error).__mro__ if each.__module__ in public)


def _details(error: Exception) -> dict[str, object]:
    """Return the attributes of an error that help a program, by name."""
    found: dict[str, object] = {}
    if isinstance(error, ServolinkError) and error.reason is not Reason.OTHER:
        found["reason"] = error.reason
    if isinstance(error, EncodeError):
        return found | {"packet": error.packet, "path": error.path}
    if isinstance(error, RequestError):
        return found | {"request": error.request and type(error.request).__name__}
    if isinstance(error, TargetNotReached):
        return found | {"late_servo_ids": sorted(error.late)}
    if isinstance(error, OSError) and error.filename is not None:
        return {"file": escape(str(error.filename))}
    return found


def silence(descriptor: int) -> None:
    """Discard further output of a broken stream, so that Python does not fail again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)


@contextmanager
def logged(verbosity: int) -> Iterator[None]:
    """Write the log of servolink to standard error: nothing (0), information (1), or every frame as well (2)."""
    if not verbosity:
        yield
        return

    class Escaping(logging.Formatter):
        def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
            return escape(super().formatMessage(record))

    logger, handler = logging.getLogger("servolink"), logging.StreamHandler()
    handler.setFormatter(Escaping("{asctime}.{msecs:03.0f} {message}", "%H:%M:%S", style="{"))
    before = logger.level
    logger.setLevel(logging.DEBUG if verbosity > 1 else logging.INFO)
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before)


def lost_output(error: OSError) -> str:
    """Return why standard output cannot be written and silence it, or "" if `error` is about something else."""
    # A failed `print` names no file.
    if error.filename is not None or error.errno not in _UNWRITABLE:
        return ""
    silence(1)
    return f"standard output cannot be written: {error.strerror}"


class Table(NamedTuple):
    """Rows of texts and numbers, escaped at printing."""

    columns: Sequence[str]
    """Their names; empty for facts, with a name and a value in each row."""
    rows: Sequence[Sequence[object]]
    title: str = ""


def table_of(columns: Mapping[str, Sequence[object]], always: Collection[str] = ()) -> Table:
    """Return a table of columns by name, without columns that are empty, unless in `always`."""
    shown = {name: cells for name, cells in columns.items() if name in always or any(cells)}
    return Table(tuple(shown), list(zip(*shown.values(), strict=True)))


def print_table(table: Table) -> None:
    """Print a table, drawn on a terminal and as plain lines elsewhere."""
    if is_terminal():
        show_table(table, console())
    else:
        print("\n".join(plain_lines(table)), flush=True)


def print_text(text: str, style: str = "") -> None:
    """Print a line of text, on a terminal in the rich `style`."""
    if style and is_terminal():
        from rich.text import Text

        console().print(Text(escape(text), style))
    else:
        print(escape(text), flush=True)


def is_terminal() -> bool:
    """Return whether standard output is a terminal on which people read text."""
    return not Form.json and sys.stdout is not None and sys.stdout.isatty()


def console(*, stderr: bool = False) -> Console:
    """Return a rich console that prints texts without reading markup in them."""
    from rich.console import Console

    return Console(stderr=stderr, markup=False, emoji=False, highlight=False)


def show_table(table: Table, terminal: Console) -> None:
    """Print a table on a terminal, or as plain lines if the terminal is too narrow, so that no value is cut off."""
    from rich.measure import Measurement

    displayed = _rich_table(table)
    anywhere = terminal.options.update(max_width=_UNBOUNDED)
    if Measurement.get(terminal, anywhere, displayed).maximum <= terminal.width:
        terminal.print(displayed)
    else:
        terminal.out("\n".join(plain_lines(_wrapped(table, terminal.width))), highlight=False)


_UNBOUNDED = 10**6
_LEAST = 20  # columns for the value of a fact


def _wrapped(table: Table, width: int) -> Table:
    """Return `table` with the values of facts wrapped between words, for a terminal that would wrap inside words."""
    if table.columns or not table.rows:
        return table
    room = max(_LEAST, width - max(text_width(str(name)) for name, _ in table.rows) - 2)
    rows: list[tuple[str, str]] = []
    for name, value in map(_cells, table.rows):
        lines = wrap(value, room, break_long_words=False, break_on_hyphens=False)
        rows += zip_longest((name,), lines or ("",), fillvalue="")
    return Table((), rows, table.title)


def _rich_table(table: Table) -> RichTable:
    """Return a table drawn by rich, without markup in cells."""
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    displayed = RichTable(
        title=Text(escape(table.title)) if table.title else None,
        title_justify="left",
        title_style="bold",
        header_style="bold",
        show_header=bool(table.columns),
        box=box.SIMPLE_HEAD if table.columns else None,
    )
    for at, name in enumerate(table.columns or ("", "")):
        displayed.add_column(Text(name), justify="right" if _is_numeric(table, at) else "left")
    for row in table.rows:
        displayed.add_row(*(Text(cell) for cell in _cells(row)))
    return displayed


def plain_lines(table: Table) -> list[str]:
    """Return `table` as aligned lines of plain text."""
    rows = [list(table.columns)] if table.columns else []
    rows += [_cells(row) for row in table.rows]
    if not rows:
        return [escape(table.title)]
    widths = [max(map(text_width, column)) for column in zip(*rows, strict=True)]
    numeric = [_is_numeric(table, at) for at in range(len(widths))]
    lines = ["  ".join(map(_padded, row, widths, numeric)).rstrip() for row in rows]
    return [escape(table.title), *lines] if table.title else lines


def counted(count: int, noun: str) -> str:
    """Return `1 pose` or `2 poses`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def angle_text(angle: int) -> str:
    """Return an angle as written by people, with the unit if known."""
    if isinstance(angle, Degrees):
        return f"{angle}° (beyond 360)" if angle.is_beyond else f"{angle}°"
    return f"{angle} ADC" if isinstance(angle, Adc) else str(angle)


SPOKEN = "servolink.spoken"
"""Error handler of the output: characters unknown to the terminal become words, or else escapes."""
_WORDS_FOR = {"°": " deg", "±": "+-"}


def _speak(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)  # noqa: S101 - only output is handled
    character = error.object[error.start]
    return _WORDS_FOR.get(character) or character.encode("ascii", "backslashreplace").decode(), error.start + 1


codecs.register_error(SPOKEN, _speak)


def _cells(row: Sequence[object]) -> list[str]:
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"  # here, as words are wider than characters
    return [_cell(value).encode(encoding, SPOKEN).decode(encoding) for value in row]


def _cell(value: object) -> str:
    """Return the text of a table cell, escaped; empty for None."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return _WORDS[value]
    return angle_text(value) if isinstance(value, Angle) else escape(str(value))


_WORDS = {True: "yes", False: "no"}


def _is_numeric(table: Table, at: int) -> bool:
    """Return whether a column holds only numbers, which are aligned to the right; facts are not."""
    values = [row[at] for row in table.rows if row[at] is not None]
    return bool(table.columns) and all(
        isinstance(value, (int, float)) and not isinstance(value, bool) for value in values
    )


def _padded(text: str, width: int, is_number: bool) -> str:  # noqa: FBT001 - one of three mapped sequences
    """Return a cell padded to a column width, numbers to the right."""
    space = " " * (width - text_width(text))
    return space + text if is_number else text + space


def text_width(text: str) -> int:
    """Return the columns `text` takes: two for a Chinese character, none for a combining accent."""
    return sum(
        0 if unicodedata.combining(character) else 2 if unicodedata.east_asian_width(character) in "WF" else 1
        for character in text
    )


def cut(text: str, width: int) -> str:
    """Return as much of `text` as fits into `width` columns."""
    left = width
    for at, character in enumerate(text):
        left -= text_width(character)
        if left < 0:
            return text[:at]
    return text


def sized(text: str, width: int) -> str:
    """Return `text` in exactly `width` columns, cut or padded."""
    text = cut(text, width)
    return text + " " * (width - text_width(text))
