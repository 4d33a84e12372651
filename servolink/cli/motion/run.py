"""`servolink run`: run a stored action or macro and, with `--wait`, follow the movement to the end."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Any, NamedTuple

from msgspec import UNSET, UnsetType

from servolink.cli.arguments import RECORD_NAME
from servolink.cli.command import MOVE, Command, flag, option
from servolink.cli.command_session import Interruption, on_board
from servolink.cli.motion.move import ANY_ANGLE, LIMITS, limits_of, make_ready
from servolink.cli.motion.servo_output import are, listed, warn_of_missing
from servolink.cli.screen.live import follow, live_bars
from servolink.cli.screen.output import print_error
from servolink.cli.screen.result import CommandResult, Returned
from servolink.client import Board, check_can_wait, collect, record_id, servos_of
from servolink.errors import ServolinkError
from servolink.motion import INTERVAL_UNIT
from servolink.project import RecordRun, name_of
from servolink.protocol import ACTION, MACRO, Action, RecordType

_STOP_LIMIT = 0.15  # seconds for a stop to be confirmed after Ctrl-C, which must end soon


class _RunServos(NamedTuple):
    """Servos that a run is for, by id."""

    here: list[int]
    """Servos present on the board."""
    idle: list[int]
    """Present servos that are stopped or released, and will not move."""


_OPTIONS = (
    option("record", "NAME", "its caption or id, as in `servolink actions`", RECORD_NAME),
    flag("--wait", "wait until it is over and the servos rest; Ctrl-C then stops them"),
    flag("--start", "start and hold servos that are stopped or released"),
    ANY_ANGLE,
    *LIMITS,
)


@Command(
    "run",
    MOVE,
    help="run an action or a macro stored on the board",
    examples=("run action 1", "run macro 1 --start --wait"),
    options=(option("kind", "action|macro", "what to run"), *_OPTIONS),
    needs_records=True,
)
@on_board(limits_of)
async def run(args: argparse.Namespace, board: Board, interruption: Interruption) -> Returned:
    """Run it. Without --wait, return at once: the board does not report the end."""
    found = await read_run(board, args.kind, args.record)
    servos = await _prepare(board, interruption, args, found)
    if args.wait:
        await play(board, interruption, found, any_angle=args.any_angle)
    else:
        name = name_of_run(found)
        interruption.state = f"{name} may have been started; `servolink stop` stops the servos"
        await start_run(board, found, any_angle=args.any_angle)
        interruption.state = f"{name} runs; `servolink stop` stops the servos"
    return _returned(args, found, servos)


ACTION_RUN = run.changed(
    name="action run",
    topic="",
    help="run an action",
    examples=("action run 1", "action run 1 --start"),
    options=_OPTIONS,
    defaults={"kind": "action"},
)
MACRO_RUN = ACTION_RUN.changed(
    name="macro run",
    help="start a macro",
    examples=("macro run 1", "macro run 1 --start"),
    defaults={"kind": "macro"},
)


async def play(board: Board, interruption: Interruption, found: RecordRun, *, any_angle: bool = False) -> None:
    """Run the record and wait for the end. An interruption stops all servos."""
    name = name_of_run(found)
    async with stopped_by_interruption(board, interruption, f"{name} was started", f"{name} was ended"):
        await start_run(board, found, any_angle=any_angle)
        await _follow(board, found)
    interruption.state = f"{name} is over"


async def start_run(board: Board, found: RecordRun, *, dry_run: bool = False, any_angle: bool = False) -> None:
    """Start the run, or with `dry_run` only check the limits, and return at once."""
    run: Any = board.run_action if isinstance(found.record, Action) else board.run_macro
    await run(_id(found), dry_run=dry_run, any_angle=any_angle)


async def read_run(board: Board, word: str, name: int | str) -> RecordRun:
    """Read an `action` or a `macro` with all records run by the macro. Raise NotFound for a missing record."""

    async def get(kind: RecordType[Any], number: int) -> Any:
        return await (board.action(number) if kind is ACTION else board.macro(number))

    kind: RecordType[Any] = ACTION if word == "action" else MACRO
    number = await record_id(board, kind, name)
    stored = await collect(get, kind, number)
    known = board.profile and board.profile.profile.settings.interval_unit
    return RecordRun(stored, kind.by_id(stored)[number], known or INTERVAL_UNIT)


async def _prepare(board: Board, interruption: Interruption, args: argparse.Namespace, found: RecordRun) -> _RunServos:
    """Check that the run is possible, and start servos if asked to."""
    await start_run(board, found, dry_run=True, any_angle=args.any_angle)
    servos = await board.servos()
    used = [servo for servo in servos if servo.servo_id in found.servo_ids()]
    here = sorted(servo.servo_id for servo in used)
    if args.wait:
        check_can_wait(found, servos)
    if missing := found.servo_ids() - set(here):
        warn_of_missing(missing)
    if args.wait or args.start:
        await make_ready(board, used, interruption, start=args.start)
        return _RunServos(here, [])
    idle = [servo.servo_id for servo in used if not (servo.is_start and servo.is_hold)]
    if idle:
        print_error(f"servolink: {are(idle)} stopped or released and will not move; --start starts and holds first")
    return _RunServos(here, idle)


@asynccontextmanager
async def stopped_by_interruption(
    board: Board, interruption: Interruption, unstopped: str, stopped: str
) -> AsyncIterator[None]:
    """Stop all servos if the block is interrupted.

    Ctrl-C then reports what is so if the stop is not confirmed, such as "action 3 was started", or what is if it is.
    """
    try:
        yield
    except asyncio.CancelledError:
        interruption.state = f"{unstopped}, and a stop was not confirmed; run `servolink stop`"
        with suppress(TimeoutError, ServolinkError):
            async with asyncio.timeout(_STOP_LIMIT):
                await board.stop()
            who = "all" if servos_of(board).known.listed else "the"
            interruption.state = f"{stopped}: {who} servos report that they are stopped and held"
        raise


async def _follow(board: Board, found: RecordRun) -> None:
    """Wait until the run is over. Raise TargetNotReached for late servos."""
    seconds, pose = found.seconds(), found.last_pose()
    if not pose:
        await asyncio.sleep(seconds)
        return
    with live_bars(pose, seconds) as draw:
        await follow(board, pose, seconds, draw)


class RecordRan(CommandResult, frozen=True, kw_only=True):
    """JSON of `run`, `action run` and `macro run`: id and caption of the action, or of the macro."""

    action_id: int | UnsetType = UNSET
    action_caption: str | UnsetType = UNSET
    macro_id: int | UnsetType = UNSET
    macro_caption: str | UnsetType = UNSET
    duration_seconds: float | None
    servo_ids: list[int]
    idle_servos: list[int]
    arrived: bool


def _returned(args: argparse.Namespace, found: RecordRun, servos: _RunServos) -> Returned:
    servo_ids, seconds = servos.here, found.known_seconds()
    name: dict[str, Any] = {
        f"{args.kind}_id": _id(found),
        f"{args.kind}_caption": RecordType.of(found.record).caption_of(found.record),
    }
    ran = RecordRan(**name, duration_seconds=seconds, servo_ids=servo_ids, idle_servos=servos.idle, arrived=args.wait)
    if args.wait:
        return Returned(ran, f"{name_of_run(found)} is over" + (f": {are(servo_ids)} at rest" if servo_ids else ""))
    takes = "" if seconds is None else f" takes {seconds:g} s and"
    moved = listed(servo_ids) if servo_ids else "no servo"
    return Returned(ran, f"{name_of_run(found)} was started; it{takes} moves {moved}")


def _id(found: RecordRun) -> int:
    return RecordType.of(found.record).id_of(found.record)


def name_of_run(found: RecordRun) -> str:
    """Return the name of what is run, such as `action 3 'Wave'`."""
    return name_of(found.record)
