"""`servolink events`: button events as they come, also after the connection was lost for a while."""

from __future__ import annotations

import argparse
import asyncio

from servolink.cli.arguments import number, whole_number
from servolink.cli.command import MOVE, Command, option
from servolink.cli.command_session import ENDLESS, KEEP_MODE, Interruption, on_board
from servolink.cli.screen.output import counted, print_error
from servolink.cli.screen.result import CommandResult, show
from servolink.client import Board, ButtonEvents
from servolink.support import ExitCode


@Command(
    "events",
    MOVE,
    help="show button events as they come",
    details=f"{ENDLESS}",
    examples=("events --seconds 2", "events --seconds 1 --json"),
    options=(
        option("--count", "N", "end after N events", whole_number(1, 10**9)),
        option("--seconds", "N", "end after N seconds", number(0.001, 10**9, "seconds")),
        KEEP_MODE,
    ),
)
@on_board(reconnect=True)
async def run(args: argparse.Namespace, board: Board, interruption: Interruption) -> int:
    """Print events until there are enough, or until Ctrl-C."""
    async with board.button_events() as events:
        print_error("listening for button events; Ctrl-C ends it")
        interruption.state = "no more events are shown"
        if args.count is None and args.seconds is None:
            interruption.code = ExitCode.OK
        reporting = asyncio.create_task(_report_states(board))
        try:
            async with asyncio.timeout(args.seconds):
                await _print_events(events, args)
        except TimeoutError:
            pass
        finally:
            reporting.cancel()
            if events.dropped:
                print_error(f"servolink: {counted(events.dropped, 'event')} lost: they came too fast")
    return ExitCode.OK


async def _report_states(board: Board) -> None:
    """Report on standard error when the connection is lost or restored."""
    was_lost = False
    async for state in board.states():
        if state == "lost":
            was_lost = True
            print_error("servolink: the connection is lost; trying to get it back")
        elif was_lost:
            print_error("servolink: the board is back")


class ButtonShown(CommandResult, frozen=True):
    """JSON of each line of `events`, in seconds since the first."""

    seconds: float
    button_id: int
    event: int
    kind: str


async def _print_events(events: ButtonEvents, args: argparse.Namespace) -> None:
    """Print button events until the end of the events or of `--count`."""
    loop = asyncio.get_running_loop()
    start, left = loop.time(), args.count
    async for event in events:
        seconds = round(loop.time() - start, 3)
        pressed = ButtonShown(seconds, event.button_id, event.event, event.kind)
        show(pressed, f"{seconds:9.3f} s  button {event.button_id}  {event.kind}")
        if left is not None:
            left -= 1
            if left == 0:
                return
