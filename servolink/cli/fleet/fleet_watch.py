"""`servolink fleet watch`: all boards in a table redrawn in place."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Sequence
from typing import TYPE_CHECKING

from servolink.cli.arguments import number
from servolink.cli.command import Command, option
from servolink.cli.command_session import ENDLESS, Interruption, interruptible
from servolink.cli.fleet.boards import battery_of, described, problems_of, state_of
from servolink.cli.fleet.broker_options import BROKER, fleet_of
from servolink.cli.screen.live import Line, can_draw, pictures
from servolink.cli.screen.output import Table, counted, cut, plain_lines
from servolink.cli.screen.result import show
from servolink.cli.screen.terminal import until_quit
from servolink.errors import escape
from servolink.support import ExitCode

if TYPE_CHECKING:
    from servolink.fleet import BoardSeen, Fleet

_EVERY = 0.5  # seconds
_MOST_PROBLEMS = 5


@Command(
    "fleet watch",
    help="show all boards live, in one table",
    details=f"{ENDLESS}",
    examples=("fleet watch --seconds 2",),
    options=(option("--seconds", "N", "end after N seconds", number(0.001, 10**9, "seconds")), *BROKER),
    takes_board=False,
)
@interruptible("nothing was changed")
async def run(args: argparse.Namespace, interruption: Interruption) -> int:
    """Show the boards until the time is over, until `q` is pressed or until Ctrl-C."""
    draws = can_draw()
    async with fleet_of(args, servos=draws, may_move=False) as fleet:
        if args.seconds is None:
            interruption.code = ExitCode.OK
        await fleet.list()
        async with until_quit(args.seconds):
            await (_draw(fleet) if draws else _print(fleet))
    return ExitCode.OK


async def _draw(fleet: Fleet) -> None:
    """Draw the table now and then."""
    with pictures(lambda width, height, blocks: picture(tuple(fleet.controller.roster), width, height)) as draw:
        while True:
            draw()
            await asyncio.sleep(_EVERY)


async def _print(fleet: Fleet) -> None:
    """Print each board, and again when something of it has changed: a line, or an object."""
    changed: dict[str, None] = dict.fromkeys(seen.name for seen in fleet.controller.roster)
    more = asyncio.Event()
    more.set()

    def note(seen: BoardSeen) -> None:
        changed[seen.name] = None
        more.set()

    fleet.controller.on_change = note
    while True:
        await more.wait()
        more.clear()
        for name in list(changed):
            del changed[name]
            if (seen := fleet.controller.roster.get(name)) is not None:
                show(described(seen), _line(seen))
        await asyncio.sleep(_EVERY)  # a board that changes all the time takes two lines a second


def _line(seen: BoardSeen) -> str:
    parts = [seen.name, state_of(seen)]
    if battery := battery_of(seen):
        parts.append(f"battery {battery}")
    if seen.now is not None and seen.now.lease:
        parts.append(f"moved by {seen.now.lease}")
    if problems := problems_of((seen,)):
        parts.append(problems[-1].removeprefix(f"{seen.name}: "))
    return "  ".join(parts)


def picture(boards: Sequence[BoardSeen], width: int, height: int) -> list[Line]:
    """Return at most `height` lines of at most `width` columns."""
    ordered = sorted(boards, key=lambda seen: (seen.urgency, seen.name))
    problems = problems_of(ordered)
    foot: list[Line] = [(text, "yellow") for text in problems[:_MOST_PROBLEMS]]
    if len(problems) > _MOST_PROBLEMS:
        foot.append((f"and {counted(len(problems) - _MOST_PROBLEMS, 'problem')} more", "dim"))
    foot.append(("boards that need a look come first; q quits", "dim"))
    online = sum(seen.is_online for seen in boards)
    head: list[Line] = [(f"{counted(len(boards), 'board')}, {online} connected", "bold"), ("", "")]
    room = max(1, height - len(head) - len(foot) - 2)
    if len(ordered) > room:
        room = max(1, room - 1)
        foot.insert(0, (f"{len(ordered) - room} more boards: enlarge the terminal", "dim"))
    shown = ordered[:room]
    names, *rows = plain_lines(_table(shown)) if shown else [""]
    styles = [_STYLES[seen.urgency] for seen in shown]
    lines = [*head, (names, "bold"), *zip(rows, styles, strict=True), ("", ""), *foot]
    return [(cut(escape(text), width), style) for text, style in lines[:height]]


_STYLES = ("bold red", "yellow", "", "dim")


def _table(boards: Sequence[BoardSeen]) -> Table:
    """Return a row for each board."""
    return Table(
        ("board", "state", "battery", "servos", "hottest", "moved by"),
        [
            (
                seen.name[:24],
                state_of(seen),
                battery_of(seen),
                seen.now and seen.now.servos,
                _hottest(seen),
                (seen.now and seen.now.lease) or "",
            )
            for seen in boards
        ],
    )


def _hottest(seen: BoardSeen) -> int | None:
    """Return the highest plausible raw temperature of the servos; None for unknown temperatures."""
    if not seen.is_online or (frame := seen.servos) is None:
        return None
    return max((servo.temperature_raw for servo in frame.servos if not servo.doubt), default=None)
