"""`servolink remote`: this computer as the remote control: keys press the buttons of a joystick table."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from servolink.cli.arguments import RECORD_NAME
from servolink.cli.command import MOVE, Command, option
from servolink.cli.command_session import Interruption, on_board
from servolink.cli.motion.move import LIMITS, limits_of
from servolink.cli.motion.run import read_run, stopped_by_interruption
from servolink.cli.motion.servo_output import are, reported
from servolink.cli.screen.output import Table, is_terminal, print_error, print_table, print_text
from servolink.cli.screen.terminal import can_ask, typed_keys
from servolink.cli.usage import usage_error
from servolink.client import Board
from servolink.errors import EncodeError, NotFound, Rejected, RequestRefused, ServolinkError
from servolink.protocol import Button, JoystickTable
from servolink.support import ExitCode

_HELP = "letter: tap; with Shift: hold until the next tap; space: stop; q or Esc: end"
_PAGES = "Tab: keys for the next buttons"
_AFTER_STOP = "all servos are stopped and held: `servolink servo start all` starts them"


def _limits(args: argparse.Namespace) -> dict[str, Any]:
    """Return the limits; without a terminal, end as wrong usage."""
    if not can_ask() or not is_terminal():
        usage_error(args, "buttons are pressed by keys, which needs a terminal; `servolink run macro NAME` needs none")
    return limits_of(args)


@Command(
    "remote",
    MOVE,
    help="press the buttons of a joystick table by keys",
    details=f"Keys: {_HELP}. {_PAGES}, if there are more buttons than letters. A tap runs the "
    "macros for press and up; a long press those for press and, 0.8 s later, for long press, and its release the "
    "one for up. Ctrl-C stops all servos and ends.",
    examples=("remote", "remote --table 1 --speed-cap 90"),
    options=(
        option("--table", "NAME", "which joystick table, by caption or id (the active one)", RECORD_NAME),
        *LIMITS,
    ),
    needs_records=True,
)
@on_board(_limits)
async def run(args: argparse.Namespace, board: Board, interruption: Interruption) -> int:
    """Show the meaning of the keys, and obey them until the end."""
    control, captions = await read_control(board, args.table)
    print_table(control.mapping(captions))
    idle = [servo.servo_id for servo in await reported(board) if not (servo.is_start and servo.is_hold)]
    if idle:
        print_error(f"servolink: {are(idle)} stopped or released and will not move; `servolink servo start` helps")
    started = "macros may have been started"
    async with stopped_by_interruption(board, interruption, started, "the remote control was ended"):
        await _obey(control, captions)
    interruption.state = "the remote control was ended"
    print_text("ended; a macro that still runs goes on, and `servolink stop` stops all servos")
    return ExitCode.OK


async def _obey(control: RemoteControl, captions: Mapping[int, str]) -> None:
    """Obey keys in order; a stop overtakes waiting keys."""
    presses: asyncio.Queue[str] = asyncio.Queue()
    worker = asyncio.create_task(_press(control, captions, presses))
    try:
        with typed_keys() as keys:
            if keys is None:
                raise RequestRefused("no keys can be read here")
            print_text(_HELP)  # only now: what is typed before is dropped
            if control.pages > 1:
                print_text(_PAGES)
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
    """Press the buttons of the keys in the queue, and print the result of each."""
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


KEYS = "abcdefghijklmnoprstuvwxyz"
"""Keys of buttons, in the order of the table: all letters but q, which ends. More buttons are on further pages."""
NEXT_PAGE = "tab"
"""The key that gives the letters to the next buttons."""

_TAP = 0.1  # seconds from press to release
_LONG = 0.8  # seconds from press to long press


class RemoteControl:
    """Imitates the buttons of the board: a tap, or a long press, released by the next tap.

    Whether it is a long press is known from the beginning, but its macro is run as late as by a board: after that for
    press, and in its place.
    """

    def __init__(self, board: Board, table: JoystickTable, seconds: Mapping[int, float | None]) -> None:
        """Start with no button down. `seconds` is how long each macro on the board runs, None for ever."""
        self._board = board
        self._seconds = seconds
        self.table = table
        self._page = 0
        self._held: set[int] = set()  # buttons that are down after a long press
        self._runs = 0  # the macro that was started last
        self._ends = 0.0  # when it ends, in seconds of the loop's clock
        self._after: Button | None = None  # released, with the button-up macro waiting for the end

    @property
    def pages(self) -> int:
        """How many pages the buttons have."""
        return -(-len(self.table.buttons) // len(KEYS))

    @property
    def buttons(self) -> dict[str, Button]:
        """The buttons of this page, by key."""
        first = self._page * len(KEYS)
        return dict(zip(KEYS, self.table.buttons[first:], strict=False))

    def turn_page(self) -> None:
        """Go to the next page, after the last page to the first. Held buttons stay down."""
        self._page = (self._page + 1) % self.pages

    @property
    def wait(self) -> float | None:
        """Seconds until `run_waiting` is due; None without a waiting macro."""
        return None if self._after is None else max(0.0, self._ends - asyncio.get_running_loop().time())

    async def run_waiting(self) -> str:
        """Run the button-up macro delayed by a long-press macro, and return a description of the call."""
        button, self._after = self._after, None
        return "" if button is None else f"button {button.button_id}: {await self._run(button.button_up_macro)}"

    async def press(self, key: str) -> str:
        """Obey a key, capital for a long press, and return a text about the effect; "" for a key without a button."""
        button = self.buttons.get(key.lower())
        if button is None:
            return ""
        name = f"button {button.button_id}"
        if button.button_id in self._held:
            self._held.discard(button.button_id)
            return f"{name} released: {await self._release(button)}"
        pressed = await self._run(button.button_press_macro)
        if not key.isupper():
            await asyncio.sleep(_TAP)
            return f"{name} pressed: {pressed}; released: {await self._run(button.button_up_macro)}"
        self._held.add(button.button_id)
        await asyncio.sleep(_LONG)
        held = await self._run(button.button_long_press_macro)
        return f"{name} pressed: {pressed}; held: {held}; the next tap releases it"

    async def stop(self) -> None:
        """Stop all servos and release all buttons, without their button-up macros."""
        self._held.clear()
        self._runs, self._after = 0, None
        await self._board.stop()

    async def _release(self, button: Button) -> str:
        """Run the button-up macro: of an uninterruptible button, not before its long-press macro has ended."""
        long_runs = self._runs != 0 and self._runs == button.button_long_press_macro
        if not (long_runs and button.uninterruptible and button.button_up_macro):
            return await self._run(button.button_up_macro)
        if self._seconds.get(self._runs) is None:
            return f"macro {self._runs} never ends, and nothing interrupts it for macro {button.button_up_macro}"
        self._after = button
        return f"macro {button.button_up_macro} waits for the end of macro {self._runs}"

    async def _run(self, macro_id: int) -> str:
        """Run a macro, 0 for none, and return the outcome as text; a refusal is an outcome too."""
        if not macro_id:
            return "no macro"
        if macro_id not in self._seconds:
            return f"macro {macro_id} is not on the board"
        try:
            await self._board.run_macro(macro_id)
        except (EncodeError, Rejected, NotFound) as error:
            return f"macro {macro_id} was refused: {error}"
        self._runs, self._after = macro_id, None
        self._ends = asyncio.get_running_loop().time() + (self._seconds[macro_id] or 0.0)
        return f"macro {macro_id}"

    def mapping(self, captions: Mapping[int, str]) -> Table:
        """Return the key, button and macros of each row of the page; `captions` are the captions of macros."""

        def name(macro_id: int) -> str:
            if not macro_id:
                return ""
            return f"{macro_id} {captions[macro_id]}".rstrip() if macro_id in captions else f"{macro_id} (missing)"

        rows = [
            (
                key,
                f"{button.button_id} {button.button_caption}".rstrip(),
                name(button.button_press_macro),
                name(button.button_long_press_macro),
                name(button.button_up_macro),
                "yes" if button.uninterruptible else "",
            )
            for key, button in self.buttons.items()
        ]
        page = f", page {self._page + 1} of {self.pages}" if self.pages > 1 else ""
        title = f"joystick table {self.table.table_id} '{self.table.table_caption}'{page}"
        return Table(("key", "button", "press", "long press", "up", "uninterruptible"), rows, title)


async def read_control(board: Board, table: int | str | None) -> tuple[RemoteControl, dict[int, str]]:
    """Read a joystick table, the active table for None, with macros and actions; return all, and the macros' captions.

    Raise NotFound if there is no such table, or if it has no buttons.
    """
    number = await board.active_joystick_table() if table is None else table
    if number is None:
        raise NotFound("the board has no active joystick table; `servolink tables` lists its tables, --table names one")
    found = await board.joystick_table(number)
    if not found.buttons:
        raise NotFound(f"joystick table {found.table_id} has no buttons")
    used = {
        macro_id
        for one in found.buttons
        for macro_id in (one.button_press_macro, one.button_long_press_macro, one.button_up_macro)
    }
    captions = {one.macro_id: one.macro_caption for one in await board.macros() if one.macro_id in used}
    seconds = {macro_id: await _seconds(board, macro_id) for macro_id in captions if macro_id}
    return RemoteControl(board, found, seconds), captions


async def _seconds(board: Board, macro_id: int) -> float | None:
    """Return the duration of a macro in seconds; None for an endless macro, 0 for a missing action."""
    with suppress(NotFound):
        return (await read_run(board, "macro", macro_id)).known_seconds()
    return 0.0
