"""`servolink move`: move servos, and by default wait until they have arrived."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext

from servolink.cli.arguments import number, speed
from servolink.cli.main import OK, refuse
from servolink.cli.motion import Draw, follow, live_bars
from servolink.cli.output import Table, is_terminal, print_json, print_table
from servolink.cli.servos import reported
from servolink.cli.session import Interruption, converse
from servolink.client.angles import Adc, Degrees
from servolink.client.board import Board
from servolink.client.motion import MotionLimits, check_limits, intervals_for
from servolink.client.servos import Servo
from servolink.errors import RequestError

DEFAULT_SPEED = 60.0
"""Degrees per second, when neither time nor speed is given."""

_TARGET = re.compile(r"([0-9]{1,3})=([+-]?[0-9]{1,5})", re.ASCII)
_FINISHING = "and the servos finish it; `servolink stop` stops them"


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink move`."""
    parser.add_argument("targets", nargs="+", type=_target, metavar="SERVO=ANGLE", help="such as 1=90 2=-45")
    pace = parser.add_mutually_exclusive_group()
    pace.add_argument(
        "--duration", type=number(0.01, 327.67, "seconds"), metavar="SECONDS", help="take so long, 0.01 to 327.67"
    )
    pace.add_argument("--speed", type=speed, metavar="N", help=f"degrees per second ({DEFAULT_SPEED:g})")
    parser.add_argument(
        "--wait", action=argparse.BooleanOptionalAction, default=True, help="wait until all have arrived (default)"
    )
    parser.add_argument("--start", action="store_true", help="start and hold servos that are stopped or released")
    parser.add_argument("--adc", action="store_true", help="angles are raw ADC readings; needs --duration")
    parser.add_argument(
        "--limit", nargs=2, type=float, metavar=("LOW", "HIGH"), help="refuse angles outside LOW to HIGH degrees"
    )
    parser.add_argument("--speed-cap", type=speed, metavar="N", help="refuse more than N degrees per second")


def run(args: argparse.Namespace) -> int:
    """Move: nothing is sent unless every servo is there and would obey."""
    kind = Adc if args.adc else Degrees
    targets = {servo_id: kind(angle) for servo_id, angle in args.targets}
    if len(targets) < len(args.targets):
        refuse(args, "a servo is given twice")
    if args.adc and args.duration is None:
        refuse(args, "--adc needs --duration: speeds are in degrees per second")
    if args.limit and not args.limit[0] <= args.limit[1]:
        refuse(args, "--limit takes the lower angle first, as in --limit -90 90")
    pace = DEFAULT_SPEED if args.speed is None and args.duration is None else args.speed
    limits = tuple(args.limit) if args.limit else None

    async def talk(board: Board, interruption: Interruption) -> int:
        before = {servo.servo_id: servo for servo in await reported(board, targets)}
        # The move checks them as well, but no servo shall be started for a move that is then refused.
        motion_limits = MotionLimits(limits, args.speed_cap)
        check_limits(targets, board.unit_of, motion_limits)
        here = {servo_id: int(before[servo_id].angle) for servo_id in targets}
        intervals_for(targets, here, motion_limits, duration=args.duration, speed=pace)
        await _ready(board, [before[servo_id] for servo_id in targets], interruption, start=args.start)
        interruption.state = f"the move may have been sent: if so, it was sent whole, {_FINISHING}"
        seconds = await board.move(targets, duration=args.duration, speed=pace)
        interruption.state = f"the move was sent, {_FINISHING}"
        after: dict[int, Servo] = {}
        if args.wait:
            with _bars(targets, shown=not args.json and is_terminal()) as draw:
                after = {servo.servo_id: servo for servo in await follow(board, targets, seconds, draw)}
            interruption.state = "all servos have arrived"
        _print(targets, before, after, seconds, as_json=args.json)
        return OK

    return converse(args, talk, angle_unit=kind.unit, angle_limits=limits, speed_cap=args.speed_cap)


async def _ready(board: Board, servos: Iterable[Servo], interruption: Interruption, *, start: bool) -> None:
    """Make sure that `servos` would obey; with `start`, start and hold those that would not."""
    idle = [servo.servo_id for servo in servos if not (servo.is_start and servo.is_hold)]
    if idle and not start:
        raise RequestError(
            f"{named(idle)} stopped or released and would ignore the movement; nothing was sent. "
            "Add --start to start and hold first"
        )
    for servo_id in idle:
        interruption.state = "no movement was sent; servos may have been started and held"
        await board.set_servo(servo_id, start=True, hold=True)


def named(servo_ids: Sequence[int]) -> str:
    """Return `servo 3 is` or `servos 3, 4 are`."""
    listed = ", ".join(map(str, servo_ids))
    return f"servo {listed} is" if len(servo_ids) == 1 else f"servos {listed} are"


def _bars(targets: Mapping[int, int], *, shown: bool) -> AbstractContextManager[Draw]:
    return live_bars(targets) if shown else nullcontext(lambda elapsed, servos: None)


def _print(
    targets: Mapping[int, int],
    before: Mapping[int, Servo],
    after: Mapping[int, Servo],
    seconds: float,
    *,
    as_json: bool,
) -> None:
    if as_json:
        servos = [
            {
                "servo_id": servo_id,
                "from_angle": int(before[servo_id].angle),
                "target_angle": int(target),
                "angle": int(after[servo_id].angle) if after else None,
                "angle_unit": "adc" if isinstance(target, Adc) else "degree",
            }
            for servo_id, target in targets.items()
        ]
        print_json({"duration_seconds": seconds, "arrived": bool(after), "servos": servos})
        return
    rows = [
        (servo_id, before[servo_id].angle, target, after[servo_id].angle if after else None)
        for servo_id, target in targets.items()
    ]
    columns = ("servo", "from", "target", "now")
    print_table(Table(columns if after else columns[:3], [row[: 4 if after else 3] for row in rows]))


def _target(text: str) -> tuple[int, int]:
    if (found := _TARGET.fullmatch(text)) is None or int(found[1]) > 0xFE:
        form = "SERVO=ANGLE, as in 1=90 or 2=-45, with servos 0 to 254 and angles of at most 5 digits"
        raise argparse.ArgumentTypeError(f"{text!r} is not {form}")
    if not -(2**15) <= int(found[2]) < 2**15:
        raise argparse.ArgumentTypeError(f"{text!r}: servo {found[1]} can be sent to -32768 to 32767, not further")
    return int(found[1]), int(found[2])
