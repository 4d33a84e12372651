"""`servolink fleet list`: who is there."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from servolink.cli.arguments import not_empty
from servolink.cli.command import Command, flag, option
from servolink.cli.command_session import Interruption, agreed, interruptible, refuse_without_answer, run_interruptible
from servolink.cli.fleet.broker_options import BROKER, NOBODY, fleet_of
from servolink.cli.screen.output import Table, counted, print_json, print_result, print_table, print_text, table_of
from servolink.errors import OpenError
from servolink.script import FAILED, NO_BOARD, OK

if TYPE_CHECKING:
    from servolink.fleet.roster import BoardSeen


@Command(
    "fleet list",
    help="list the boards, with their batteries and problems",
    examples=("fleet list",),
    options=(*BROKER,),
    takes_board=False,
)
@interruptible("nothing was changed")
async def run_list(args: argparse.Namespace, interruption: Interruption) -> int:
    """Print every board known to the broker; return 0 if any board is connected."""
    async with fleet_of(args, may_move=False) as fleet:
        boards = await fleet.list()
    if args.json:
        print_json({"boards": [described(seen) for seen in boards]})
    elif boards:
        print_table(boards_table(boards))
        for text in problems_of(boards):
            print_text(text, "yellow")
    if any(seen.is_online for seen in boards):
        return OK
    if args.json or boards:
        return NO_BOARD
    raise OpenError(NOBODY)


def described(seen: BoardSeen) -> dict[str, Any]:
    """Return what is known of a board, for programs."""
    import msgspec

    now = {} if seen.now is None else msgspec.to_builtins(seen.now)
    return {**now, "board": seen.name, "is_online": seen.is_online, "unreadable": seen.problem or None}


def state_of(seen: BoardSeen) -> str:
    """Return how a board is, in a word."""
    if not seen.is_online:
        return "offline"
    if seen.now is None:
        return "unknown"
    return "ready" if seen.now.connection == "connected" else f"board {seen.now.connection}"


def battery_of(seen: BoardSeen) -> str:
    """Return the charge of the battery as text, empty if it is unknown."""
    percent = seen.now and seen.now.battery_percent
    return "" if percent is None else f"{percent:g} %"


def boards_table(boards: Sequence[BoardSeen]) -> Table:
    """Return a row for each board, without empty columns."""
    nows = [seen.now for seen in boards]
    columns: dict[str, list[object]] = {
        "board": [seen.name for seen in boards],
        "state": [state_of(seen) for seen in boards],
        "battery": [battery_of(seen) or None for seen in boards],
        "may": [now and now.allow for now in nows],
        "servos": [now and now.servos for now in nows],
        "moved by": [seen.now.lease if seen.now and seen.is_online else None for seen in boards],
        "version": [now and now.version for now in nows],
        "machine": [now and now.host for now in nows],
    }
    return table_of(columns)


def problems_of(boards: Iterable[BoardSeen]) -> list[str]:
    """Return what is wrong, a line each."""
    found = []
    for seen in boards:
        problems = seen.now.problems if seen.now is not None and seen.is_online else ()
        found += [f"{seen.name}: {text}" for text in (seen.problem, *problems) if text]
    return found


@Command(
    "fleet doctor",
    help="find out what is wrong with the broker, the network and the boards",
    examples=("fleet doctor",),
    options=(*BROKER,),
    takes_board=False,
)
@interruptible("nothing was changed")
async def run_doctor(args: argparse.Namespace, interruption: Interruption) -> int:
    """Examine the fleet; return 0 if nothing is wrong, else 1."""
    async with fleet_of(args, may_move=False) as fleet:
        findings = await fleet.doctor()
        online, known = len(fleet.controller.roster.online), len(fleet.controller.roster)
    if args.json:
        found = [{"about": one.about, "observation": one.observation, "remedy": one.remedy} for one in findings]
        print_json({"boards": known, "online": online, "findings": found})
    else:
        print_text(f"the broker answers; {online} of {counted(known, 'board')} connected")
        for number, one in enumerate(findings, 1):
            print_text("")
            print_text(f"{number}. {one.about}", "bold")
            print_table(Table((), [("observation", one.observation), ("remedy", one.remedy)]))
        if not findings:
            print_text("nothing is wrong")
    return FAILED if findings else OK


_UNCHANGED = "nothing was forgotten"


@Command(
    "fleet forget",
    help="remove boards that have left for good from the list",
    examples=("fleet forget rex --yes",),
    options=(
        option("boards", "BOARD", "name of a board that is offline", not_empty, nargs="+"),
        flag("--yes", "do not ask"),
        *BROKER,
    ),
    takes_board=False,
)
def run_forget(args: argparse.Namespace) -> int:
    """Remove the retained messages of offline boards from the broker, after asking."""
    refuse_without_answer(args)
    boards = list(dict.fromkeys(args.boards))

    async def main(interruption: Interruption) -> int:
        async with fleet_of(args, may_move=False) as fleet:
            if not await agreed(args, interruption, f"forget {', '.join(boards)} until they join again?"):
                return FAILED
            interruption.state = "some boards may be forgotten"
            await fleet.forget(*boards)
        print_result(args, {"forgotten": boards}, f"forgotten: {', '.join(boards)}")
        return OK

    return run_interruptible(main, _UNCHANGED)
