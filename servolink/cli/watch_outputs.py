"""Where `servolink watch` shows its readings: a screen, lines of text, lines of JSON, and a file for spreadsheets."""

from __future__ import annotations

import asyncio
import csv
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from servolink.cli.live import pictures
from servolink.cli.output import angle_text, print_error, print_json, print_text
from servolink.cli.servos import servo_object
from servolink.cli.watch_picture import Watched, picture
from servolink.client.alarms import RaisedAlarm
from servolink.errors import ServolinkError
from servolink.files import open_file, reason
from servolink.motion.angles import Angle

_PICTURE_EVERY = 0.05  # seconds, at most


class Output(Protocol):
    """Shows what is known of a watched board."""

    def reading(self) -> None:
        """Show the latest reading, and what came with it."""

    def note(self, text: str) -> None:
        """Show that something has happened to the connection."""

    def alarms(self, alarms: Sequence[RaisedAlarm]) -> None:
        """Show the alarms of the latest reading, which has been shown."""


class Lines:
    """A line for each servo and reading and for each button event, or an object for each reading.

    Notes are on standard error.
    """

    def __init__(self, watched: Watched, *, as_json: bool) -> None:
        """Print the names of the columns."""
        self._watched = watched
        self._as_json = as_json
        if not as_json:
            print_text(f"{'seconds':>9}  servo  {'angle':>8}  current_raw  temperature_raw  state")

    def reading(self) -> None:
        """Print the latest reading."""
        if self._as_json:
            print_json(_described(self._watched))
            return
        for seconds, event in self._watched.new_buttons:
            print_text(f"{seconds:9.3f}  button {event.button_id} {event.kind}")
        for servo in self._watched.servos:
            print_text(
                f"{self._watched.seconds:9.3f}  {servo.servo_id:5}  {angle_text(servo.angle):>8}  {servo.current:11}  "
                f"{servo.temperature:15}  {servo.state}"
            )

    def note(self, text: str) -> None:
        """Print `text`."""
        print_error(f"servolink: {text}")

    def alarms(self, alarms: Sequence[RaisedAlarm]) -> None:
        """Print a note for each."""
        for raised in alarms:
            self.note(f"{raised}{'; stopping all servos' if raised.alarm.stops else ''}")


def _described(watched: Watched) -> dict[str, Any]:
    """Return the latest reading, and what came with it, for `--json`."""
    reading, stats = watched.reading, watched.stats
    alarms = reading.alarms if reading else ()
    return {
        "seconds": round(watched.seconds, 3),
        "servos": [servo_object(servo, watched.captions) for servo in watched.servos],
        "missed": reading.missed if reading else 0,
        "battery_percent": watched.battery,
        "button_events": [
            {"seconds": round(seconds, 3), "button_id": event.button_id, "event": event.event, "kind": event.kind}
            for seconds, event in watched.new_buttons
        ],
        "alarms": [{"alarm": str(one.alarm), "servo_id": one.servo_id, "value_raw": one.value} for one in alarms],
        "noise_bytes": watched.skipped_bytes,
        "late_responses": stats.late_responses,
        "retries": stats.retries,
        "reconnects": stats.reconnects,
    }


class Screen:
    """Pictures on a terminal."""

    def __init__(self, watched: Watched, draw: Callable[[], None]) -> None:
        """Show `watched` with `draw`."""
        self._watched = watched
        self._draw = draw
        self._due = 0.0

    def reading(self) -> None:
        """Draw the latest reading, unless the picture before is too new for people."""
        now = asyncio.get_running_loop().time()
        if now >= self._due or (self._watched.reading and self._watched.reading.alarms):
            self._due = now + _PICTURE_EVERY
            self._draw()

    def note(self, text: str) -> None:
        """Draw what there is now, which includes what `text` says."""
        self._draw()

    def alarms(self, alarms: Sequence[RaisedAlarm]) -> None:
        """Do nothing: the picture of the reading shows them."""


@contextmanager
def screen(watched: Watched) -> Iterator[Screen]:
    """Yield the screen of the terminal."""
    with pictures(lambda width, height, blocks: picture(watched, width, height, blocks=blocks)) as draw:
        yield Screen(watched, draw)


_CSV_COLUMNS = ("seconds", "servo_id", "angle", "angle_unit", "current_raw", "temperature_raw", "state", "missed")


def may_replace(path: Path) -> bool:
    """Return whether `csv_file` may open a file: there is none, it is empty, or it was written in this way."""
    header = ",".join(_CSV_COLUMNS).encode("ascii")
    if not path.is_file():
        return True
    try:
        with open_file(path) as file:
            return file.read(len(header)) in {b"", header}
    except OSError:
        return True  # opening it to write says what is wrong


@contextmanager
def csv_file(watched: Watched, path: Path) -> Iterator[Callable[[], None]]:
    """Yield a function that writes the latest reading to a new file, a row for each servo.

    Captions are left out: a spreadsheet would take one such as `=1+1` for a formula.
    """
    with _named(path), path.open("w", encoding="ascii", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(_CSV_COLUMNS)

        def write() -> None:
            with _named(path):
                rows.writerows(_csv_rows(watched))
                file.flush()

        yield write


def _csv_rows(watched: Watched) -> Iterator[tuple[object, ...]]:
    missed = watched.reading.missed if watched.reading else 0
    for servo in watched.servos:
        unit = servo.angle.unit if isinstance(servo.angle, Angle) else ""
        state = servo.current, servo.temperature, servo.state
        yield f"{watched.seconds:.3f}", servo.servo_id, int(servo.angle), unit, *state, missed


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Raise ServolinkError, which names the file, if it cannot be written."""
    try:
        yield
    except OSError as error:
        raise ServolinkError(f"{path} cannot be written: {reason(error)}") from error
