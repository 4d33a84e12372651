"""`servolink stop` and `servolink release`: end all motion, or let servos go limp."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from servolink.cli.main import FAILED, OK, refuse
from servolink.cli.output import print_text
from servolink.cli.servos import print_servos, reported
from servolink.cli.session import Interruption, converse
from servolink.client.board import Board
from servolink.errors import ServolinkError
from servolink.protocol.servos import ALL_SERVOS

_WARNING = "released servos are limp, and raised limbs fall"


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `command`."""
    if command == "release":
        parser.add_argument("servo_ids", nargs="*", type=servo_id, metavar="SERVO", help="which servos (all)")
        parser.add_argument("--yes", action="store_true", help=f"do not ask: {_WARNING}")


def run(args: argparse.Namespace) -> int:
    """Stop or release, and say what the servos then report."""
    return _stop(args) if args.command == "stop" else _release(args)


def _stop(args: argparse.Namespace) -> int:
    async def talk(board: Board, interruption: Interruption) -> int:
        interruption.state = "the stop was not confirmed; run `servolink stop` again"
        await board.stop()
        interruption.state = "all servos report that they are stopped and held"
        servos = await board.servos()
        if not args.json:
            print_text(f"all {len(servos)} servos report that they are stopped and held")
        print_servos(servos, as_json=args.json)
        return OK

    return converse(args, talk, greet=False)


def _release(args: argparse.Namespace) -> int:
    which = f"servos {', '.join(map(str, args.servo_ids))}" if args.servo_ids else "all servos"
    if not args.yes and not may_release(args, which):
        return FAILED

    async def talk(board: Board, interruption: Interruption) -> int:
        await reported(board, args.servo_ids)
        interruption.state = f"{which} may have been released; `servolink stop` holds all servos again"
        await _release_each(board, args.servo_ids or [ALL_SERVOS])
        interruption.state = f"{which} were released"
        print_servos(await board.servos(), as_json=args.json)
        return OK

    return converse(args, talk)


async def _release_each(board: Board, servo_ids: Sequence[int]) -> None:
    for done, servo_id in enumerate(servo_ids):
        try:
            await board.release(servo_id)
        except ServolinkError:
            if done:
                limp = ", ".join(map(str, servo_ids[:done]))
                print(f"servolink: released and limp: {limp}; `servolink stop` holds all servos again", file=sys.stderr)
            raise


def may_release(args: argparse.Namespace, which: str) -> bool:
    """Ask a person whether servos may go limp; a program has to say --yes."""
    if args.json or sys.stdin is None or not sys.stdin.isatty():
        refuse(args, f"{_WARNING}; say --yes if they may")
    print(f"{_WARNING}. Release {which}? [y/N] ", end="", file=sys.stderr, flush=True)
    try:
        answer = sys.stdin.readline()
    except KeyboardInterrupt:
        print("\ninterrupted: nothing was sent", file=sys.stderr)
        raise
    if answer.strip().lower() in ("y", "yes"):
        return True
    print("servolink: nothing was released", file=sys.stderr)
    return False


def servo_id(text: str) -> int:
    """Read the id of a servo."""
    if not (text.isascii() and text.isdecimal() and int(text) < ALL_SERVOS):
        raise argparse.ArgumentTypeError(f"{text!r} is no servo id, 0 to 254")
    return int(text)
