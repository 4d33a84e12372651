"""`servolink move`, `stop` and `release`: start and end movements of servos."""

from __future__ import annotations

import argparse
import re
from collections.abc import Collection, Iterable, Sequence
from typing import Any

from msgspec import Struct
from msgspec.structs import astuple

from servolink.boards import BoardProfile
from servolink.cli.arguments import SERVO_NAME, SPEED, number
from servolink.cli.command import MOVE, Command, flag, group, one_of, option
from servolink.cli.command_session import Interruption, agreed, on_board, refuse_unasked, run_with_board
from servolink.cli.motion.servo_output import listed, reported, servos_returned
from servolink.cli.screen.live import follow, live_bars
from servolink.cli.screen.output import Table, print_error
from servolink.cli.screen.result import CommandResult, Ending, Returned
from servolink.cli.usage import usage_error
from servolink.client import Board, Servo, find_servos, find_targets, servos_of
from servolink.errors import ProfileError, ServolinkError, quote
from servolink.motion import Adc, Angle, Degrees, idle_servos
from servolink.protocol import ALL_SERVOS
from servolink.support import ExitCode

DEFAULT_SPEED = 60.0
"""Degrees per second, at most, when neither time nor speed is given."""

_TARGET = re.compile(r"(.+)=(.+)", re.DOTALL)
_WHOLE = re.compile(r"[+-]?[0-9]{1,9}", re.ASCII)
_FINISHING = "and the servos finish it; `servolink stop` stops them"


ANY_ANGLE = flag(
    "--any-angle", "allow angles beyond ±360 degrees for servos without limits, and servos with impossible readings"
)
LIMITS = (
    group(
        "limits, besides those of `servolink board show`",
        option(
            "--limit",
            ("LOW", "HIGH"),
            "refuse angles outside LOW to HIGH degrees; without it any angle is sent",
            float,
            nargs=2,
        ),
        option("--speed-cap", "N", "refuse more than N degrees per second", SPEED),
        option("--soft-start", "N", "begin with N degrees per second at most, wherever servos are", SPEED),
    ),
)


def limits_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of `connect` for those of the command line."""
    if args.limit and not args.limit[0] <= args.limit[1]:
        usage_error(args, "--limit takes the lower angle first, as in --limit -90 90")
    angles = tuple(args.limit) if args.limit else None
    return {"angle_limits": angles, "speed_cap": args.speed_cap, "soft_start": args.soft_start}


def servo_angle(text: str) -> tuple[int | str, int]:
    """Return servo (id or caption) and angle of a text such as `1=90` or `hip=90`, for argparse."""
    found = _TARGET.fullmatch(text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{quote(text)} is not of the form SERVO=ANGLE, as in 1=90, hip=-45 or all=0")
    try:
        servo = SERVO_NAME(found[1])
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f"{quote(text)} is not of the form SERVO=ANGLE; the servo {error}") from None
    name = f"servo {servo}" if isinstance(servo, int) else repr(servo)
    if not _WHOLE.fullmatch(found[2]):
        raise argparse.ArgumentTypeError(f"the angle of {name} must be a whole number of degrees, not {found[2]}")
    if not -(2**15) <= int(found[2]) < 2**15:
        raise argparse.ArgumentTypeError(f"the angle of {name} must be from -32768 to 32767, not {found[2]}")
    return servo, int(found[2])


@Command(
    "move",
    MOVE,
    help="move servos to angles",
    examples=("move 1=90 2=-45", "move 1=30 --speed 20 --no-wait", "move 1=80 --limit -90 90 --duration 0.5"),
    options=(
        option("targets", "SERVO=ANGLE", "such as 1=90 hip=-45 or all=0", servo_angle, nargs="+"),
        one_of(
            option("--duration", "SECONDS", "how long it takes, 0.01 to 327.67", number(0.01, 327.67, "seconds")),
            option("--speed", "N", f"degrees per second ({DEFAULT_SPEED:g}, or what the servo's cap allows)", SPEED),
        ),
        flag("--wait", "wait until all have arrived (default)", action=argparse.BooleanOptionalAction, default=True),
        flag("--start", "start and hold servos that are stopped or released"),
        flag("--adc", "angles are raw ADC readings; needs --duration"),
        ANY_ANGLE,
        *LIMITS,
    ),
)
def run_move(args: argparse.Namespace) -> int:
    """Move, unless a servo is missing or would ignore it: nothing is sent then."""
    kind, unit = (Adc, "adc") if args.adc else (Degrees, "degree")
    named: dict[int | str, Angle] = {servo: kind(angle) for servo, angle in args.targets}
    if len(named) < len(args.targets):
        usage_error(args, "a servo is given twice")
    if args.adc and args.duration is None:
        usage_error(args, "--adc needs --duration: speeds are in degrees per second")

    async def talk(board: Board, interruption: Interruption) -> Returned:
        found, captions = await find_targets(board, named)
        targets = {servo_id: kind(angle) for servo_id, angle in found.items()}
        before = {servo.servo_id: servo for servo in await reported(board, targets)}
        pace = _speeds(board, targets) if args.speed is None and args.duration is None else args.speed
        started = "servos may have been started and held, and " if args.start else ""
        interruption.state = f"{started}the move may have been sent: if so, it was sent whole, {_FINISHING}"
        seconds = await board.move(
            targets, duration=args.duration, speed=pace, start=args.start, any_angle=args.any_angle
        )
        interruption.state = f"the move was sent, {_FINISHING}"
        after: dict[int, Servo] = {}
        if args.wait:
            with live_bars(targets) as draw:
                after = {servo.servo_id: servo for servo in await follow(board, targets, seconds, draw)}
            interruption.state = "all servos have arrived"
        moves = [
            MovedServo(each, captions.get(each), before[each].angle, target, after[each].angle if after else None, unit)
            for each, target in targets.items()
        ]
        return Returned(ServosMoved(seconds, all(move.angle is not None for move in moves), moves), _table(moves))

    return run_with_board(args, talk, angle_unit=kind.unit, **limits_of(args))


def _speeds(board: Board, servo_ids: Iterable[int]) -> dict[int, float]:
    """Return the default speed of each servo, within all caps."""
    return {servo_id: min(DEFAULT_SPEED, board.limits.cap_of(servo_id) or DEFAULT_SPEED) for servo_id in servo_ids}


async def make_ready(board: Board, servos: Iterable[Servo], interruption: Interruption, *, start: bool) -> None:
    """Raise RequestRefused if some of `servos` would ignore a move, or with `start`, start and hold those."""
    idle = [servo.servo_id for servo in servos if not (servo.is_start and servo.is_hold)]
    if idle and not start:
        raise idle_servos(idle)
    for servo_id in idle:
        interruption.state = "no movement was sent; servos may have been started and held"
        await board.set_servo(servo_id, start=True, hold=True)


class MovedServo(Struct, frozen=True):
    """Movement of one servo: target, and angle afterwards; null with `--no-wait`."""

    servo_id: int
    servo_caption: str | None
    from_angle: int
    target_angle: int
    angle: int | None
    angle_unit: str


class ServosMoved(CommandResult, frozen=True):
    """JSON of `move`; `arrived` says whether the servos were waited for."""

    duration_seconds: float
    arrived: bool
    servos: list[MovedServo]


def _table(moves: Sequence[MovedServo]) -> Table:
    names = ("servo", "caption", "from", "target", "now")
    columns = dict(zip(names, zip(*(astuple(move)[:-1] for move in moves), strict=True), strict=True))
    known = {name: values for name, values in columns.items() if any(value is not None for value in values)}
    return Table([*known], [*zip(*known.values(), strict=True)])


_WARNING = "released servos are limp, and raised limbs fall"


def check_can_release(args: argparse.Namespace) -> None:
    """End as wrong usage without --yes and without a terminal for the question."""
    refuse_unasked(args, f"{_WARNING}; add --yes if they may")


@Command(
    "stop",
    MOVE,
    help="stop all servos and keep holding them",
    examples=("stop",),
    hint="; `servolink stop` stops all servos, `servolink servo hold SERVO` one",
)
def run_stop(args: argparse.Namespace) -> int:
    """Stop, and print what the servos then report."""

    async def talk(board: Board, interruption: Interruption) -> Returned:
        interruption.state = "the stop was not confirmed; run `servolink stop` again"
        await board.stop()
        listed_ids = servos_of(board).known.listed
        interruption.state = f"{'all' if listed_ids else 'the'} servos report that they are stopped and held"
        try:
            servos = await reported(board, may_be_adc=True)
        except ServolinkError as error:
            raise ServolinkError(f"{interruption.state}; they cannot be shown: {error}") from error
        return servos_returned(servos, {}, f"{_reporting(servos, listed_ids)} stopped and held")

    # The handshake comes after the stop, and a stop may be repeated.
    options: dict[str, Any] = {"greet": False, "repeats": True, "handshake": False}
    try:
        return run_with_board(args, talk, **options)
    except ProfileError as error:
        print_error(f"servolink: {error}; stopping without it")
        return run_with_board(args, talk, profile=BoardProfile(), **options)


def _reporting(servos: Sequence[Servo], listed_ids: Collection[int] | None) -> str:
    """Return whose stop was confirmed, such as `all 4 servos report that they are`, counted against the list."""
    ids = {servo.servo_id for servo in servos}
    if not listed_ids or not ids.issuperset(listed_ids):
        return f"{listed(sorted(ids))}, on a board that does not list its servos, {'is' if len(ids) == 1 else 'are'}"
    if len(listed_ids) == 1:
        return "the only servo reports that it is"
    return f"all {len(listed_ids)} servos report that they are"


@Command(
    "release",
    MOVE,
    help="let servos go limp",
    examples=("release --yes", "release 1 2 --yes --json"),
    options=(
        option("servos", "SERVO", "which servos, by id or caption (all)", SERVO_NAME, nargs="*", default=[]),
        flag("--yes", f"do not ask: {_WARNING}"),
    ),
)
@on_board(check_can_release)
async def run_release(args: argparse.Namespace, board: Board, interruption: Interruption) -> Ending:
    """Release servos, and print what the servos then report."""
    servo_ids, captions = await find_chosen(board, args.servos)
    await reported(board, servo_ids, may_be_adc=True)
    which = listed(servo_ids) if servo_ids else "all servos"
    if not await may_release(args, interruption, which):
        return ExitCode.FAILED
    interruption.state = f"{which} may have been released; `servolink stop` holds all servos again"
    await _release_each(board, servo_ids or [ALL_SERVOS])
    interruption.state = f"{which} released; `servolink stop` holds all servos again"
    return servos_returned(await board.servos(), captions)


SERVO_RELEASE = run_release.changed(name="servo release", topic="", examples=("servo release 1 2 --yes",))


async def chosen_servos(board: Board, servos: Sequence[int | str]) -> list[int]:
    """Return the ids of servos, each once; none if all are meant."""
    return (await find_chosen(board, servos))[0]


async def find_chosen(board: Board, servos: Sequence[int | str]) -> tuple[list[int], dict[int, str]]:
    """Return the ids of servos, like `chosen_servos`, and the captions read on the way, by id."""
    chosen, captions = await find_servos(board, servos)
    return [] if ALL_SERVOS in chosen else [*dict.fromkeys(chosen)], captions


async def _release_each(board: Board, servo_ids: Sequence[int]) -> None:
    for done, servo_id in enumerate(servo_ids):
        try:
            await board.release(servo_id)
        except ServolinkError:
            if done:
                limp = ", ".join(map(str, servo_ids[:done]))
                print_error(f"servolink: released and limp: {limp}; `servolink stop` holds all servos again")
            raise


async def may_release(args: argparse.Namespace, interruption: Interruption, which: str) -> bool:
    """Return whether the servos may go limp, after asking if need be."""
    interruption.state = "nothing was released"
    return await agreed(args, interruption, f"{_WARNING}. Release {which}?")
