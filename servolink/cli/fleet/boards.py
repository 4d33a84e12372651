"""`servolink fleet list`: who is there."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from msgspec import Struct, to_builtins

from servolink.cli.arguments import not_empty
from servolink.cli.command import Command, flag, option
from servolink.cli.command_session import Interruption, agreed, interruptible, refuse_without_answer
from servolink.cli.fleet.broker_options import BROKER, NOBODY, fleet_of
from servolink.cli.screen.output import Table, counted, table_of
from servolink.cli.screen.result import CommandResult, Ending, Part, Remark, Returned, Text
from servolink.support import ExitCode

if TYPE_CHECKING:
    from servolink.fleet import BoardSeen


class FleetListed(CommandResult, frozen=True):
    """JSON of `fleet list`: boards in the form of `fleet watch`."""

    boards: list[dict[str, Any]]


class FleetProblem(Struct, frozen=True):
    """Problem of the broker, the network or a board, with its remedy."""

    about: str
    observation: str
    remedy: str


class FleetExamined(CommandResult, frozen=True):
    """JSON of `fleet doctor`: numbers of known and connected boards, and problems."""

    boards: int
    online: int
    findings: list[FleetProblem]


class FleetForgotten(CommandResult, frozen=True):
    """JSON of `fleet forget`: the boards that were removed from the list."""

    forgotten: list[str]


@Command(
    "fleet list",
    help="list the boards, with their batteries and problems",
    examples=("fleet list",),
    options=(*BROKER,),
    takes_board=False,
)
@interruptible("nothing was changed")
async def run_list(args: argparse.Namespace, interruption: Interruption) -> Returned:
    """Return every board known to the broker; end with 0 if any board is connected."""
    async with fleet_of(args, may_move=False) as fleet:
        boards = await fleet.list()
    value = FleetListed([described(seen) for seen in boards])
    text: Text = Remark(NOBODY)
    if boards:
        text = [boards_table(boards), *((problem, "yellow") for problem in problems_of(boards))]
    return Returned(value, text, ExitCode.OK if any(seen.is_online for seen in boards) else ExitCode.NO_BOARD)


def described(seen: BoardSeen) -> dict[str, Any]:
    """Return what is known of a board, for programs."""
    now = {} if seen.now is None else to_builtins(seen.now)
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
async def run_doctor(args: argparse.Namespace, interruption: Interruption) -> Returned:
    """Examine the fleet; return 0 if nothing is wrong, else 1."""
    async with fleet_of(args, may_move=False) as fleet:
        findings = await fleet.doctor()
        online, known = len(fleet.controller.roster.online), len(fleet.controller.roster)
    found = [FleetProblem(one.about, one.observation, one.remedy) for one in findings]
    text: list[Part] = [f"the broker answers; {online} of {counted(known, 'board')} connected"]
    for number, one in enumerate(found, 1):
        facts = Table((), [("observation", one.observation), ("remedy", one.remedy)])
        text += ["", (f"{number}. {one.about}", "bold"), facts]
    if not found:
        text.append("nothing is wrong")
    return Returned(FleetExamined(known, online, found), text, ExitCode.FAILED if found else ExitCode.OK)


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
@interruptible(_UNCHANGED)
async def run_forget(args: argparse.Namespace, interruption: Interruption) -> Ending:
    """Remove the retained messages of offline boards from the broker, after asking."""
    refuse_without_answer(args)
    boards = list(dict.fromkeys(args.boards))
    async with fleet_of(args, may_move=False) as fleet:
        if not await agreed(args, interruption, f"forget {', '.join(boards)} until they join again?"):
            return ExitCode.FAILED
        interruption.state = "some boards may be forgotten"
        await fleet.forget(*boards)
    return Returned(FleetForgotten(boards), f"forgotten: {', '.join(boards)}")
