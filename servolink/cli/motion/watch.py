"""`servolink watch`: the servos of a board, live, with alarms and a file for spreadsheets."""

from __future__ import annotations

import argparse
import asyncio
import csv
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TypeAlias

from msgspec import Struct

from servolink.cli.arguments import SERVO_NAME, alarm, new_file, number
from servolink.cli.command import MOVE, Command, flag, option
from servolink.cli.command_session import ENDLESS, KEEP_MODE, Interruption, is_answered, refuse_unasked, run_with_board
from servolink.cli.motion.events import ButtonShown
from servolink.cli.motion.move import chosen_servos
from servolink.cli.motion.servo_output import ServoReport, known_captions, reported
from servolink.cli.screen.live import can_draw, pictures
from servolink.cli.screen.output import angle_text, print_error
from servolink.cli.screen.result import CommandResult, print_for_people, show
from servolink.cli.screen.servo_picture import Watched, picture
from servolink.cli.screen.terminal import confirm, until_quit
from servolink.cli.usage import usage_error
from servolink.client import Alarm, Board, RaisedAlarm
from servolink.errors import ConnectionLost, NotFound, ServolinkError
from servolink.motion import Angle
from servolink.support import ExitCode, open_file, reason

_MOST_HZ = 50.0
_BATTERY_EVERY = 10.0  # seconds


@Command(
    "watch",
    MOVE,
    help="show all servos live, with alarms and a file for spreadsheets",
    details=f"{ENDLESS}",
    examples=(
        "watch --seconds 2",
        "watch 1 2 --hz 50 --seconds 1 --json",
        "watch --alarm 'current_raw>800 for 0.5s' --seconds 1",
    ),
    options=(
        option("servos", "SERVO", "which servos to show, by id or caption (all)", SERVO_NAME, nargs="*", default=[]),
        option("--hz", "N", "readings a second (10)", number(0.1, _MOST_HZ, "readings a second"), default=10.0),
        option("--seconds", "N", "end after N seconds", number(0.001, 10**9, "seconds")),
        option("--csv", "FILE", "also write a row for each servo and reading, for a spreadsheet", new_file),
        flag("--yes", "replace FILE without asking"),
        option(
            "--alarm",
            "RULE",
            "such as 'temperature_raw>300' or 'current_raw>800 for 0.5s', about any servo; may be repeated",
            alarm,
            action="append",
            default=[],
        ),
        option(
            "--on-alarm",
            "warn|stop|exit",
            "say so (warn), stop and hold all servos too, or exit with code 1",
            default="warn",
        ),
        KEEP_MODE,
    ),
)
def run(args: argparse.Namespace) -> int:
    """Show readings until the time is over, until `q` is pressed or until Ctrl-C."""
    if args.csv is not None and args.csv.is_dir():
        usage_error(args, f"{args.csv} is a folder; name a file in it")

    if args.csv is not None and not may_replace(args.csv):
        usage_error(args, f"{args.csv} exists and holds no such rows, so it is not replaced; choose another name")
    asks = args.csv is not None and args.csv.exists() and not args.yes
    if asks:
        refuse_unasked(args, f"{args.csv} exists; --yes replaces it")

    async def talk(board: Board, interruption: Interruption) -> int:
        if asks and not await confirm(f"{args.csv} exists. Replace it?"):
            print_error(f"servolink: {args.csv} was not replaced")
            return ExitCode.FAILED
        watched = await _begin(board, args)
        if args.seconds is None:
            interruption.code = ExitCode.OK
        with ExitStack() as stack:
            write = stack.enter_context(csv_file(watched, args.csv)) if args.csv else None
            output = stack.enter_context(screen(watched)) if can_draw() else ReadingPrinter(watched)
            return await _ReadingLoop(board, watched, args, output, interruption).run(write)

    return run_with_board(args, talk, reconnect=True)


async def _begin(board: Board, args: argparse.Namespace) -> Watched:
    """Return what is known of a board before the first reading. Raise NotFound if a servo is missing."""
    chosen = await chosen_servos(board, args.servos)
    there = {servo.servo_id for servo in await reported(board)}
    if missing := [servo_id for servo_id in chosen if servo_id not in there]:
        raise NotFound(f"the board has no servo {missing[0]}")
    alarms = [Alarm.parse(text, stops=args.on_alarm == "stop") for text in args.alarm]
    watched = Watched(board.url, args.hz, board.stats, alarms, frozenset(chosen))
    if (profile := board.profile) is not None:
        watched.limits = profile.limits
        watched.name = f"{profile.name} {board.url}" if profile.name else board.url
    watched.captions = await known_captions(board)
    watched.begun = asyncio.get_running_loop().time()
    return watched


class _ReadingLoop:
    """Reads a board and shows the reports of the board."""

    def __init__(
        self, board: Board, watched: Watched, args: argparse.Namespace, output: Shows, interruption: Interruption
    ) -> None:
        self._board = board
        self._watched = watched
        self._args = args
        self._output = output
        self._interruption = interruption
        self._losses = 0  # of the connection

    async def run(self, write: Callable[[], None] | None) -> int:
        """Show readings, and `write` each of them, until the end. Return the exit code."""
        tasks = [asyncio.create_task(each) for each in (self._states(), self._battery(), self._buttons())]
        try:
            code: int = ExitCode.OK
            async with until_quit(self._args.seconds):
                code = await self._readings(write)
            return code  # noqa: RET504 - OK when the time is over
        finally:
            for task in tasks:
                task.cancel()

    async def _readings(self, write: Callable[[], None] | None) -> int:
        watched = self._watched
        async with self._board.watch(self._args.hz, alarms=watched.alarms) as readings:
            async for reading in readings:
                watched.take(reading)
                self._output.reading()
                if write is not None:
                    write()
                watched.new_buttons.clear()
                if reading.alarms and self._args.on_alarm == "exit":
                    raise ServolinkError(str(reading.alarms[0]))
                self._output.alarms(reading.alarms)
                if any(raised.alarm.stops for raised in reading.alarms):
                    self._interruption.state = "an alarm has sent a stop to all servos"
        return ExitCode.OK

    async def _states(self) -> None:
        """Report when the connection is lost, and when it is back."""
        async for state in self._board.states():
            self._watched.state = state
            if state == "lost":
                self._losses += 1
                self._output.note("the connection is lost; trying to get it back")
            elif self._losses:
                self._output.note("the board is back")

    async def _battery(self) -> None:
        """Ask for the battery now and then, until a response is missing: missing responses delay readings."""
        while is_answered(self._board, "QueryRemainPower"):
            losses = self._losses
            try:
                self._watched.battery = await self._board.battery()
            except ServolinkError as error:
                self._watched.battery = None
                # Through a hub that has lost the board, there is only silence.
                if not (isinstance(error, ConnectionLost) or self._watched.state == "lost" or self._losses > losses):
                    return
            await asyncio.sleep(_BATTERY_EVERY)

    async def _buttons(self) -> None:
        """Keep button events. A board without buttons has none."""
        loop = asyncio.get_running_loop()
        with suppress(ServolinkError):
            async for event in self._board.button_events():
                self._watched.press(event, loop.time())


_PICTURE_EVERY = 0.05  # seconds, at most

Shows: TypeAlias = "ReadingPrinter | Screen"
"""Output of a watch: it shows readings, and notes about the connection."""


class ReadingPrinter:
    """A line for each servo and reading and for each button event, or an object for each reading.

    Notes are on standard error.
    """

    def __init__(self, watched: Watched) -> None:
        self._watched = watched
        print_for_people(f"{'seconds':>9}  servo  {'angle':>8}  current_raw  temperature_raw  state")

    def reading(self) -> None:
        """Print the latest reading."""
        show(_described(self._watched), self._lines())

    def _lines(self) -> Iterator[str]:
        for seconds, event in self._watched.new_buttons:
            yield f"{seconds:9.3f}  button {event.button_id} {event.kind}"
        for servo in self._watched.servos:
            yield (
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


class RaisedBy(Struct, frozen=True):
    """Alarm with servo and value."""

    alarm: str
    servo_id: int
    value_raw: int


class WatchedReading(CommandResult, frozen=True):
    """JSON of each line of `watch`: a reading, with the buttons and alarms since the one before."""

    seconds: float
    servos: list[ServoReport]
    missed: int
    battery_percent: float | None
    button_events: list[ButtonShown]
    alarms: list[RaisedBy]
    noise_bytes: int
    late_responses: int
    retries: int
    reconnects: int


def _described(watched: Watched) -> WatchedReading:
    """Return the latest reading, with buttons and alarms."""
    reading, stats = watched.reading, watched.stats
    alarms = reading.alarms if reading else ()
    return WatchedReading(
        round(watched.seconds, 3),
        [ServoReport.of(servo, watched.captions) for servo in watched.servos],
        reading.missed if reading else 0,
        watched.battery,
        [
            ButtonShown(round(seconds, 3), event.button_id, event.event, event.kind)
            for seconds, event in watched.new_buttons
        ],
        [RaisedBy(str(one.alarm), one.servo_id, one.value) for one in alarms],
        watched.skipped_bytes,
        stats.late_responses,
        stats.retries,
        stats.reconnects,
    )


class Screen:
    """Pictures on a terminal."""

    def __init__(self, watched: Watched, draw: Callable[[], None]) -> None:
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
        """Draw the current picture, which includes the news of `text`."""
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
    """Return whether `csv_file` may open a file: a missing or empty file, or a file of the same format."""
    header = ",".join(_CSV_COLUMNS).encode("ascii")
    if not path.is_file():
        return True
    try:
        with open_file(path) as file:
            return file.read(len(header)) in {b"", header}
    except OSError:
        return True  # opening the file for writing raises the right error


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
    """Yield a row of the CSV file for each servo of the latest reading."""
    missed = watched.reading.missed if watched.reading else 0
    for servo in watched.servos:
        unit = servo.angle.unit if isinstance(servo.angle, Angle) else ""
        state = servo.current, servo.temperature, servo.state
        yield f"{watched.seconds:.3f}", servo.servo_id, int(servo.angle), unit, *state, missed


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Raise ServolinkError with the name of the file for a failed write."""
    try:
        yield
    except OSError as error:
        raise ServolinkError(f"{path} cannot be written: {reason(error)}") from error
