"""View of a hub by `servolink share`: a status row, notices, and a table for `--status`."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager

from msgspec import Struct

from servolink.cli.screen.live import staying_line
from servolink.cli.screen.output import Table, counted, cut, print_error, table_of
from servolink.control import (
    ConnectionNow,
    HoldNotice,
    HubStatus,
    LeaseNotice,
    LeaseStatus,
    ProblemNotice,
    ProgramNotice,
    RefusedNotice,
)
from servolink.errors import escape

_STATES = {
    "connected": "the board is back",
    "lost": "the connection to the board is lost; trying to get it back",
    "closed": "the board is closed",
}
_ANOTHER = "plug the right one in again, or end this program and start it again to use the other one"


def text_of(notice: Struct, who: str) -> str:
    """Return a notice caused by `who` as a sentence for people, not escaped; empty for a notice to programs."""
    match notice:
        case ProgramNotice("joined" | "left" as event):
            return f"{notice.who} {event}" + (f" ({notice.door})" if notice.door else "")
        case ConnectionNow(state, another):
            return f"{another}; {_ANOTHER}" if another else _STATES[state]
        case LeaseNotice("asked for"):
            return "a program asks for the lease"
        case LeaseNotice(event, _, lease):
            return f"{'nobody' if lease is None else lease.who} has the lease now ({event})"
        case HoldNotice(hold):
            taken = hold and f"{hold.who} has exclusive use of the board: {hold.reason}"
            return taken or "all may use the board again"
        case RefusedNotice(packet, reason):
            return f"{who}: {packet} was not sent: {reason}"
        case ProblemNotice(text):
            return text
        case _:
            return ""


def is_for_the_log(notice: Struct) -> bool:
    """Return whether a notice is worth a line where nobody watches."""
    return isinstance(notice, ConnectionNow | ProblemNotice)


class Rate:
    """Responses per second, from one look to the next."""

    def __init__(self) -> None:
        self._before: tuple[float, int] | None = None

    def of(self, status: HubStatus, now: float) -> float:
        """Return the rate since the look before."""
        before, self._before = self._before, (now, status.responses)
        if before is None or now <= before[0]:
            return 0.0
        return (status.responses - before[1]) / (now - before[0])


def status_line(status: HubStatus, rate: float, width: int) -> str:
    """Return the line that stays, cut to `width` columns."""
    parts = [
        status.name if status.state == "connected" else f"{status.name} ({status.state})",
        counted(len(status.programs), "program"),
        f"{rate:.0f} responses/s",
        f"noise {status.noise} B",
        f"lease: {'free' if status.lease is None else status.lease.who}",
    ]
    if status.hold is not None:
        parts.insert(1, f"exclusively used by {status.hold.who}")
    return cut(escape("  ".join(parts)), width)


def facts(status: HubStatus) -> Table:
    """Return what is true of the whole hub, as a table of facts."""
    hold = status.hold
    return Table(
        (),
        [
            ("hub", f"share://{status.name}"),
            ("board", f"{status.url} ({status.state})"),
            *([("in its place", status.another)] if status.another else []),
            ("shared for", _duration(status.since)),
            *(("door", url) for url in status.doors[1:]),
            ("lease", _lease(status.lease)),
            ("exclusive use by", "nobody" if hold is None else f"{hold.who}: {hold.reason}"),
            ("responses", f"{status.responses:,}"),
            ("noise", f"{counted(status.noise, 'byte')} from the board that belong to no frame"),
        ],
    )


def _lease(lease: LeaseStatus | None) -> str:
    """Return the holder of a lease, with times in seconds, as text."""
    if lease is None:
        return "free: the next program that moves servos has it"
    watched = "" if lease.dead_man is None else f", and must report every {lease.dead_man:g} s"
    return f"{lease.who} for {_duration(lease.since)}{watched}"


def programs(status: HubStatus) -> Table:
    """Return a row for each program, without empty columns."""
    there = status.programs
    columns: dict[str, list[str | int | None]] = {
        "program": [each.who for each in there],
        "door": [each.door for each in there],
        "role": [None if each.role == "edit" else each.role for each in there],
        "for": [_duration(each.since) for each in there],
        "requests": [each.requests for each in there],
        "responses": [each.responses for each in there],
        "unanswered": [each.unanswered for each in there],
        "refused": [each.refused for each in there],
        "garbage": [each.garbage for each in there],
    }
    return table_of(columns, always=("requests", "responses"))


def _duration(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"


Show = Callable[[Struct, str], None]
"""Shows a notice, caused by a program."""


@contextmanager
def in_the_log() -> Iterator[Show]:
    """Yield a function that writes important notices to standard error, for a hub without a terminal."""

    def show(notice: Struct, who: str) -> None:
        if is_for_the_log(notice):
            print_error(f"servolink: {text_of(notice, who)}")

    yield show


@asynccontextmanager
async def on_terminal(look: Callable[[], HubStatus]) -> AsyncIterator[Show]:
    """Yield a function that prints notices above a status row with the regularly read result of `look`."""
    rate, loop = Rate(), asyncio.get_running_loop()

    def line(width: int) -> tuple[bool, str]:
        status = look()
        return status.state == "connected", status_line(status, rate.of(status, loop.time()), width)

    async with staying_line(line) as show:
        yield lambda notice, who: show(text_of(notice, who), "")
