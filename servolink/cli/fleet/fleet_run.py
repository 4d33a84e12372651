"""`servolink fleet run` and `servolink fleet stop`: many boards at the same moment."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from servolink.cli.arguments import RECORD_NAME, number
from servolink.cli.command import Command, flag, option
from servolink.cli.command_session import Interruption, interruptible
from servolink.cli.fleet.broker_options import BROKER, GROUPS, NOBODY, boards_of, fleet_of
from servolink.cli.screen.output import counted
from servolink.cli.screen.result import CommandResult, Part, Remark, Returned
from servolink.support import ExitCode

if TYPE_CHECKING:
    from servolink.fleet import RanTogether, Stopped


@Command(
    "fleet run",
    help="start an action or a macro on many boards at the same moment",
    examples=("fleet run Wave", "fleet run Wave --start", "fleet run Wave --on rex,fido --anyway"),
    options=(
        option("name", "NAME", "caption or id of an action or a macro", RECORD_NAME),
        option(
            "--type", "action|macro", "type of the record, where boards have both types under that name", dest="kind"
        ),
        flag("--start", "start and hold servos that are stopped or released"),
        flag("--anyway", "start the others if some boards cannot"),
        *GROUPS,
        *BROKER,
    ),
    takes_board=False,
)
@interruptible()
async def run_together(args: argparse.Namespace, interruption: Interruption) -> Returned:
    """Prepare all boards, and start the prepared boards with a single message."""
    async with boards_of(args) as fleet:
        interruption.state = "boards may have been started; `servolink fleet stop` stops all"
        ran = await fleet.run(args.name, args.on or "all", kind=args.kind, anyway=args.anyway, start=args.start)
        interruption.state = "boards were started; `servolink fleet stop` stops all"
    value = FleetStarted(
        started=ran.started,
        held_back=ran.held_back,
        failed=ran.failed,
        may_have_started=ran.may_have_started,
        spread_seconds=ran.spread,
        measured_by=ran.measured_by,
        duration_seconds=ran.duration,
        idle_servos=ran.idle_servos,
    )
    code = ExitCode.FAILED if ran.failed or not ran.started else ExitCode.OK
    return Returned(value, _ran_text(ran, args.name), code)


class FleetStarted(CommandResult, frozen=True, kw_only=True):
    """JSON of `fleet run`: boards by how it went, and the seconds between the first and the last start."""

    started: Sequence[str]
    held_back: Sequence[str]
    failed: Mapping[str, str]
    may_have_started: Sequence[str]
    spread_seconds: float | None
    measured_by: str | None
    duration_seconds: float | None
    idle_servos: Mapping[str, Sequence[int]]


class FleetHalted(CommandResult, frozen=True, kw_only=True):
    """JSON of `fleet stop`: seconds to the stop of each board, and the boards that may still move."""

    stopped: dict[str, float]
    failed: Mapping[str, str]
    silent: Sequence[str]
    offline: Sequence[str]


def _ran_text(ran: RanTogether, name: int | str) -> Iterator[Part]:
    """Yield failed, doubtful and started boards, and the spread of the starts in milliseconds."""
    yield from map(Remark, ran.failed.values())
    if ran.may_have_started:
        yield Remark(
            f"perhaps started, without an answer: {', '.join(ran.may_have_started)}; `servolink fleet stop` stops all"
        )
    if not ran.started and not ran.may_have_started:
        ready = f"; --anyway starts those that are ready: {', '.join(ran.held_back)}" if ran.held_back else ""
        yield Remark(f"no board was started{ready}")
    if not ran.started:
        return
    yield f"{name} was started on {counted(len(ran.started), 'board')}: {', '.join(ran.started)}"
    if ran.idle_servos:
        yield Remark(
            f"servos are stopped or released, and do not move: {', '.join(ran.idle_servos)}; "
            "--start starts and holds those of the run first"
        )
    if ran.spread is not None:
        how = "by the clock of their machine" if ran.measured_by == "clock" else "estimated from the delay of messages"
        yield f"between the first and the last start: {ran.spread * 1000:.1f} ms, {how}"
    if ran.duration is not None:
        yield f"it takes {ran.duration:g} s"


@Command(
    "fleet stop",
    help="stop all servos of all boards, or of some",
    examples=("fleet stop", "fleet stop --on arms"),
    options=(
        option(
            "--within",
            "SECONDS",
            "when a board that does not answer counts as silent (5)",
            number(0.1, 3600, "seconds"),
            default=5.0,
        ),
        *GROUPS,
        *BROKER,
    ),
    takes_board=False,
)
@interruptible("nothing was stopped")
async def run_stop(args: argparse.Namespace, interruption: Interruption) -> Returned:
    """Stop every chosen board, again and again until each has answered or is silent."""
    async with fleet_of(args, may_move=False) as fleet:
        interruption.state = "a stop was sent, and not every board has answered; send it again"
        stopped = await fleet.stop(args.on or "all", patience=args.within)
    value = FleetHalted(
        stopped={board: round(seconds, 4) for board, seconds in stopped.stopped.items()},
        failed=stopped.failed,
        silent=stopped.silent,
        offline=stopped.offline,
    )
    code = ExitCode.FAILED if not stopped.is_complete else ExitCode.OK if stopped.stopped else ExitCode.NO_BOARD
    return Returned(value, _stopped_text(stopped), code)


def _stopped_text(stopped: Stopped) -> Iterator[Part]:
    """Yield stopped boards, silent boards and boards that may still move."""
    if stopped.stopped:
        count, last = len(stopped.stopped), max(stopped.stopped.values())
        each = "it reports" if count == 1 else "each reports"
        yield f"stopped {counted(count, 'board')} within {last * 1000:.0f} ms: {each} that its servos hold", "green"
    yield from (Remark(f"{board} may still move: {text}") for board, text in stopped.failed.items())
    if stopped.silent:
        yield Remark(f"no answer, and may still move: {', '.join(stopped.silent)}")
    if stopped.offline:
        yield Remark(f"not connected, so nothing could be sent to: {', '.join(stopped.offline)}")
    if not (stopped.stopped or stopped.failed or stopped.silent or stopped.offline):
        yield Remark(NOBODY)
