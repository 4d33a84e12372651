"""`servolink run`: run an action or a macro that is stored on the board."""

from __future__ import annotations

import argparse
import sys

from servolink.cli.main import OK
from servolink.cli.move import named
from servolink.cli.output import print_json, print_text
from servolink.cli.session import Interruption, converse
from servolink.cli.stored import record_id
from servolink.client.board import Board


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink run`."""
    parser.add_argument("kind", choices=("action", "macro"), help="what to run")
    parser.add_argument("id", type=record_id, metavar="ID", help="its id, as in `servolink actions`")
    parser.add_argument("--start", action="store_true", help="start and hold servos that are stopped or released")


def run(args: argparse.Namespace) -> int:
    """Run it; returns when the board has been told, as the board does not say when it is done."""

    async def talk(board: Board, interruption: Interruption) -> int:
        if args.kind == "action":
            return await _run_action(board, interruption, args)
        return await _run_macro(board, interruption, args)

    return converse(args, talk)


async def _run_action(board: Board, interruption: Interruption, args: argparse.Namespace) -> int:
    action = await board.action(args.id)
    idle = await _wake(board, interruption, {step.servo_id for step in action.steps}, start=args.start)
    interruption.state = f"action {action.action_id} may have been started; `servolink stop` stops the servos"
    await board.run_action(action.action_id)
    interruption.state = f"action {action.action_id} runs; `servolink stop` stops the servos"
    seconds = max((step.interval for step in action.steps), default=0) / 100
    if args.json:
        described = {"action_id": action.action_id, "action_caption": action.action_caption}
        print_json({**described, "duration_seconds": seconds, "idle_servos": idle})
    else:
        print_text(f"action {action.action_id} '{action.action_caption}' was sent; it takes {seconds:g} s")
    return OK


async def _run_macro(board: Board, interruption: Interruption, args: argparse.Namespace) -> int:
    macro = await board.macro(args.id)
    idle = await _wake(board, interruption, None, start=args.start)
    interruption.state = f"macro {macro.macro_id} may have been started; `servolink stop` ends it"
    await board.run_macro(macro.macro_id)
    interruption.state = f"macro {macro.macro_id} runs; `servolink stop` ends it"
    if args.json:
        print_json({"macro_id": macro.macro_id, "macro_caption": macro.macro_caption, "idle_servos": idle})
    else:
        print_text(f"macro {macro.macro_id} '{macro.macro_caption}' was started")
    return OK


async def _wake(board: Board, interruption: Interruption, wanted: set[int] | None, *, start: bool) -> list[int]:
    """Start servos that would ignore what is run (None: any servo), or warn of them; return those that stay idle."""
    idle = [
        servo.servo_id
        for servo in await board.servos()
        if not (servo.is_start and servo.is_hold) and (wanted is None or servo.servo_id in wanted)
    ]
    if idle and not start:
        text = f"{named(idle)} stopped or released and will not move; --start starts and holds first"
        print(f"servolink: {text}", file=sys.stderr)
        return idle
    for servo_id in idle:
        interruption.state = "nothing was run; servos may have been started and held"
        await board.set_servo(servo_id, start=True, hold=True)
    return []
