"""`servolink watch`: the servos of a board, live, with alarms and a file for spreadsheets."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

from servolink.cli.arguments import SERVO_NAME, alarm, new_file, number
from servolink.cli.main import FAILED, OK, fail, usage_error
from servolink.cli.motion import chosen_servos
from servolink.cli.output import print_error
from servolink.cli.servos import known_captions, reported
from servolink.cli.session import ENDLESS, Interruption, is_answered, run_with_board
from servolink.cli.terminal import can_ask, confirm, single_keys
from servolink.errors import ConnectionLost, NotFound, ServolinkError

if TYPE_CHECKING:  # and imported late: `--help` needs none of it
    from servolink.cli.watch_outputs import Output
    from servolink.cli.watch_picture import Watched
    from servolink.client.board import Board

_MOST_HZ = 50.0
_BATTERY_EVERY = 10.0  # seconds


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink watch`."""
    parser.set_defaults(run=run)
    parser.description = f"{parser.description}\n\n{ENDLESS}"
    parser.add_argument(
        "servos",
        nargs="*",
        default=[],
        type=SERVO_NAME,
        metavar="SERVO",
        help="which servos to show, by id or caption (all)",
    )
    parser.add_argument(
        "--hz",
        type=number(0.1, _MOST_HZ, "readings a second"),
        default=10.0,
        metavar="N",
        help="readings a second (10)",
    )
    parser.add_argument("--seconds", type=number(0.001, 10**9, "seconds"), metavar="N", help="end after N seconds")
    parser.add_argument(
        "--csv", type=new_file, metavar="FILE", help="also write a row for each servo and reading, for a spreadsheet"
    )
    parser.add_argument("--yes", action="store_true", help="replace FILE without asking")
    parser.add_argument(
        "--alarm",
        type=alarm,
        action="append",
        default=[],
        metavar="RULE",
        help="such as 'temperature_raw>300' or 'current_raw>800 for 0.5s', about any servo; may be repeated",
    )
    parser.add_argument(
        "--on-alarm",
        choices=("warn", "stop", "exit"),
        default="warn",
        metavar="warn|stop|exit",
        help="say so (warn), stop and hold all servos too, or exit with code 1",
    )


def run(args: argparse.Namespace) -> int:
    """Show readings until the time is over, until `q` is pressed or until Ctrl-C."""
    if args.csv is not None and args.csv.is_dir():
        usage_error(args, f"{args.csv} is a folder; name a file in it")
    from servolink.cli.watch_outputs import Lines, csv_file, may_replace, screen

    if args.csv is not None and not may_replace(args.csv):
        usage_error(args, f"{args.csv} exists and holds no such rows, so it is not replaced; choose another name")
    asks = args.csv is not None and args.csv.exists() and not args.yes
    if asks and (args.json or not can_ask()):
        usage_error(args, f"{args.csv} exists; --yes replaces it")

    from servolink.cli.live import can_draw

    async def talk(board: Board, interruption: Interruption) -> int:
        if asks and not await confirm(f"{args.csv} exists. Replace it?"):
            print_error(f"servolink: {args.csv} was not replaced")
            return FAILED
        watched = await _begin(board, args)
        if args.seconds is None:
            interruption.code = OK
        with ExitStack() as stack:
            write = stack.enter_context(csv_file(watched, args.csv)) if args.csv else None
            on_screen = not args.json and can_draw()
            output = stack.enter_context(screen(watched)) if on_screen else Lines(watched, as_json=args.json)
            return await _Watch(board, watched, args, output, interruption).run(write)

    return run_with_board(args, talk, reconnect=True)


async def _begin(board: Board, args: argparse.Namespace) -> Watched:
    """Return what is known of a board before the first reading. Raise NotFound if a servo is missing."""
    from servolink.cli.watch_picture import Watched
    from servolink.client.alarms import Alarm

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


class _Watch:
    """Reads a board and shows what it reports."""

    def __init__(
        self, board: Board, watched: Watched, args: argparse.Namespace, output: Output, interruption: Interruption
    ) -> None:
        """Keep `watched` up to date."""
        self._board = board
        self._watched = watched
        self._args = args
        self._output = output
        self._interruption = interruption
        self._losses = 0  # of the connection

    async def run(self, write: Callable[[], None] | None) -> int:
        """Show readings, and `write` each of them, until the end. Return the exit code."""
        tasks = [asyncio.create_task(each) for each in (self._states(), self._battery(), self._buttons())]
        limit = asyncio.timeout(self._args.seconds)
        try:
            async with limit:
                with single_keys(lambda keys: limit.reschedule(0.0) if "q" in keys.lower() else None):
                    return await self._readings(write)
        except TimeoutError:
            if not limit.expired():  # the board did not answer
                raise
            return OK
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
                    return fail(str(reading.alarms[0]), FAILED)
                self._output.alarms(reading.alarms)
                if any(raised.alarm.stops for raised in reading.alarms):
                    self._interruption.state = "an alarm has sent a stop to all servos"
        return OK

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
        """Ask for the battery now and then. A board that does not answer is not asked again: that delays readings."""
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
