"""`servolink remote`: this computer as the remote control: keys press the buttons of a joystick table."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

from servolink.cli.arguments import RECORD_NAME
from servolink.cli.main import OK, usage_error
from servolink.cli.motion import add_limits, limits_of
from servolink.cli.output import is_terminal, print_error, print_table, print_text
from servolink.cli.run import stopped_by_interruption
from servolink.cli.servos import are, reported
from servolink.cli.session import Interruption, run_with_board
from servolink.cli.terminal import can_ask, keys_in, single_keys
from servolink.errors import RequestError, ServolinkError

if TYPE_CHECKING:  # and imported late: --help needs none of it
    from servolink.cli.remote_control import RemoteControl
    from servolink.client.board import Board

_HELP = "letter: tap; with Shift: hold until the next tap; space: stop; q or Esc: end"
_PAGES = "Tab: keys for the next buttons"
_AFTER_STOP = "all servos are stopped and held: `servolink servo start all` starts them"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink remote`."""
    parser.set_defaults(run=run)
    parser.description = (
        f"{parser.description}\n\nKeys: {_HELP}. {_PAGES}, if there are more buttons than letters. A tap runs the "
        "macros for press and up; a long press those for press and, 0.8 s later, for long press, and its release the "
        "one for up. Ctrl-C stops all servos and ends."
    )
    parser.add_argument(
        "--table", type=RECORD_NAME, metavar="NAME", help="which joystick table, by caption or id (the active one)"
    )
    add_limits(parser)


def run(args: argparse.Namespace) -> int:
    """Show what the keys do, and obey them until somebody ends it."""
    if args.json or not can_ask() or not is_terminal():
        usage_error(args, "buttons are pressed by keys, which needs a terminal; `servolink run macro NAME` needs none")

    async def talk(board: Board, interruption: Interruption) -> int:
        from servolink.cli.remote_control import read_control

        control, captions = await read_control(board, args.table)
        print_table(control.mapping(captions))
        idle = [servo.servo_id for servo in await reported(board) if not (servo.is_start and servo.is_hold)]
        if idle:
            print_error(f"servolink: {are(idle)} stopped or released and will not move; `servolink servo start` helps")
        print_text(_HELP)
        if control.pages > 1:
            print_text(_PAGES)
        started = "macros may have been started"
        async with stopped_by_interruption(board, interruption, started, "the remote control was ended"):
            await _obey(control, captions)
        interruption.state = "the remote control was ended"
        print_text("ended; a macro that still runs goes on, and `servolink stop` stops all servos")
        return OK

    return run_with_board(args, talk, **limits_of(args))


async def _obey(control: RemoteControl, captions: Mapping[int, str]) -> None:
    """Obey keys, one after the other; a stop overtakes those that wait."""
    keys: asyncio.Queue[str] = asyncio.Queue()

    def typed(text: str) -> None:
        for key in keys_in(text):
            keys.put_nowait(key)

    presses: asyncio.Queue[str] = asyncio.Queue()
    worker = asyncio.create_task(_press(control, captions, presses))
    try:
        with single_keys(typed) as keyboard:
            if not keyboard:
                raise RequestError("no keys can be read here")
            while (key := await _next(keys, worker)) not in ("q", "Q", "esc"):
                if key == "space":
                    await _ended(worker)
                    await control.stop()
                    print_text(_AFTER_STOP)
                    presses = asyncio.Queue()
                    worker = asyncio.create_task(_press(control, captions, presses))
                else:
                    presses.put_nowait(key)
    finally:
        await _ended(worker)


async def _next(keys: asyncio.Queue[str], worker: asyncio.Task[None]) -> str:
    """Return the next key. Raise what ends the worker meanwhile, such as ConnectionLost."""
    getting = asyncio.ensure_future(keys.get())
    try:
        await asyncio.wait((getting, worker), return_when=asyncio.FIRST_COMPLETED)
        if worker.done():
            worker.result()
        return await getting
    finally:
        getting.cancel()


async def _ended(worker: asyncio.Task[None]) -> None:
    worker.cancel()
    with suppress(asyncio.CancelledError, ServolinkError):
        await worker


async def _press(control: RemoteControl, captions: Mapping[int, str], presses: asyncio.Queue[str]) -> None:
    """Press what comes, and say what that did."""
    from servolink.cli.remote_control import NEXT_PAGE

    while True:
        try:
            async with asyncio.timeout(control.wait):
                key = await presses.get()
        except TimeoutError:
            said = await control.run_waiting()
        else:
            said = ""
            if key != NEXT_PAGE:
                said = await control.press(key)
            elif control.pages > 1:
                control.turn_page()
                print_table(control.mapping(captions))
        if said:
            print_text(said)
