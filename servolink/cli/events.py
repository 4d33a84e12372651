"""`servolink events`: button events as they come, also after the board was gone for a while."""

from __future__ import annotations

import argparse
import asyncio
import sys

from servolink.cli.main import OK
from servolink.cli.output import print_json, print_text
from servolink.cli.session import Interruption, run_with_board
from servolink.client.board import Board
from servolink.client.events import ButtonEvents


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink events`."""
    parser.set_defaults(run=run)
    parser.add_argument("--count", type=_count, metavar="N", help="end after N events")
    parser.add_argument("--seconds", type=_seconds, metavar="N", help="end after N seconds")


def run(args: argparse.Namespace) -> int:
    """Print events until Ctrl-C, which is their normal end."""

    async def talk(board: Board, interruption: Interruption) -> int:
        async with board.button_events() as events:
            print("listening for button events until Ctrl-C", file=sys.stderr, flush=True)
            interruption.state, interruption.code = "no more events are shown", OK
            telling = asyncio.create_task(_tell_states(board))
            try:
                async with asyncio.timeout(args.seconds):
                    await _print_events(events, args)
            except TimeoutError:
                pass
            finally:
                telling.cancel()
                if events.dropped:
                    print(f"servolink: {events.dropped} events came too fast and were lost", file=sys.stderr)
        return OK

    return run_with_board(args, talk, reconnect=True)


async def _tell_states(board: Board) -> None:
    async for state in board.states():
        if state == "lost":
            print("servolink: the connection is lost; trying to get it back", file=sys.stderr, flush=True)
        elif board.stats.reconnects:
            print("servolink: the board is back", file=sys.stderr, flush=True)


async def _print_events(events: ButtonEvents, args: argparse.Namespace) -> None:
    loop = asyncio.get_running_loop()
    start, left = loop.time(), args.count
    async for event in events:
        seconds = round(loop.time() - start, 3)
        if args.json:
            described = {"button_id": event.button_id, "event": event.event, "kind": event.kind}
            print_json({"seconds": seconds, **described})
        else:
            print_text(f"{seconds:9.3f} s  button {event.button_id}  {event.kind}")
        if left is not None:
            left -= 1
            if left == 0:
                return


def _count(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and 0 < int(text) < 10**9):
        raise argparse.ArgumentTypeError(f"{text!r} is no number of events, 1 or more")
    return int(text)


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = 0.0
    if not 0 < seconds < 10**9:
        raise argparse.ArgumentTypeError(f"{text!r} is no time in seconds, above 0")
    return seconds
