"""`servolink fleet forget`: remove boards that have left for good from the list."""

from __future__ import annotations

import argparse

from servolink.cli.arguments import not_empty
from servolink.cli.fleet import add_broker, fleet_of
from servolink.cli.main import FAILED, OK
from servolink.cli.output import print_json, print_text
from servolink.cli.session import Interruption, refuse_without_answer, run_interruptible
from servolink.cli.terminal import confirm

_UNCHANGED = "nothing was forgotten"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink fleet forget`."""
    parser.set_defaults(run=run)
    parser.add_argument("boards", nargs="+", type=not_empty, metavar="BOARD", help="name of a board that is offline")
    parser.add_argument("--yes", action="store_true", help="do not ask")
    add_broker(parser)


def run(args: argparse.Namespace) -> int:
    """Remove what the broker keeps of boards that are offline, after asking."""
    refuse_without_answer(args)
    boards = list(dict.fromkeys(args.boards))

    async def main(interruption: Interruption) -> int:
        async with fleet_of(args) as fleet:
            if not args.yes and not await confirm(f"forget {', '.join(boards)} until they join again?"):
                print_text(_UNCHANGED)
                return FAILED
            interruption.state = "some boards may be forgotten"
            await fleet.forget(*boards)
        if args.json:
            print_json({"forgotten": boards})
        else:
            print_text(f"forgotten: {', '.join(boards)}")
        return OK

    return run_interruptible(main, _UNCHANGED)
