"""`servolink servos`: reports of the servos, shared with the commands that move servos."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from servolink.cli.command import MOVE, Command, flag
from servolink.cli.command_session import KEEP_MODE, Interruption, is_answered, run_with_board
from servolink.cli.screen.output import Table, print_error, print_json, print_table
from servolink.errors import NotFound, Rejected, RequestTimeout
from servolink.motion.angles import Angle
from servolink.script import OK

if TYPE_CHECKING:
    from servolink.client.board import Board
    from servolink.client.servo_state import Servo


@Command(
    "servos",
    MOVE,
    help="show angle, current and temperature of each servo",
    examples=("servos", "servos --adc", "servos --json"),
    options=(flag("--adc", "angles as raw ADC readings instead of degrees"), KEEP_MODE),
)
def run(args: argparse.Namespace) -> int:
    """Print the servos."""

    async def talk(board: Board, interruption: Interruption) -> int:
        servos = await reported(board, may_be_adc=True)
        print_servos(servos, as_json=args.json, captions=await known_captions(board))
        return OK

    return run_with_board(args, talk, angle_unit="adc" if args.adc else "degree")


SERVO_LIST = run.changed(name="servo list", topic="", examples=("servo list", "servo list --json"))


async def known_captions(board: Board) -> dict[int, str]:
    """Return the stored captions by servo id; for a board without a response, print a remark and return none.

    One whose profile says that it does not is not asked.
    """
    if not is_answered(board, "QueryServoParameter"):
        return {}
    try:
        return {servo.servo_id: servo.servo_caption for servo in await board.servo_parameters()}
    except RequestTimeout as error:
        print_error(f"servolink: shown without captions: {error}")
        return {}


async def reported(board: Board, wanted: Iterable[int] = (), *, may_be_adc: bool = False) -> tuple[Servo, ...]:
    """Return the reports of all servos. Raise NotFound for a board without servos or without a `wanted` one.

    With `may_be_adc`, angles are raw ADC with a remark if the board refuses degrees; for commands that send no angles.
    """
    try:
        servos = await board.servos()
    except Rejected as error:  # a board without servos refuses the unit of their angles
        if not await board.servo_ids():
            servos = ()
        elif may_be_adc:
            await board.set_angle_unit("adc")
            print_error(f"servolink: angles are shown as raw ADC: {error}")
            servos = await board.servos()
        else:
            raise
    if not servos:
        raise NotFound("the board has no servos")
    there = {servo.servo_id for servo in servos}
    if missing := [servo_id for servo_id in wanted if servo_id not in there]:
        raise NotFound(f"the board has no servo {missing[0]}; nothing was moved")
    return servos


def listed(servo_ids: Sequence[int]) -> str:
    """Return `servo 3` or `servos 3, 4`."""
    return f"servo{'s' if len(servo_ids) > 1 else ''} {', '.join(map(str, servo_ids))}"


def warn_of_missing(servo_ids: Collection[int]) -> None:
    """Print a remark about servos of an action that the board lacks; the servos may be connected later."""
    whose = "their" if len(servo_ids) > 1 else "its"
    print_error(f"servolink: the board has no {listed(sorted(servo_ids))} now: {whose} steps move nothing")


def are(servo_ids: Sequence[int]) -> str:
    """Return `servo 3 is` or `servos 3, 4 are`."""
    return f"{listed(servo_ids)} {'are' if len(servo_ids) > 1 else 'is'}"


def servo_object(servo: Servo, captions: Mapping[int, str]) -> dict[str, Any]:
    """Return the report of a servo for `--json`; its caption is None unless in `captions`."""
    return {
        "servo_id": servo.servo_id,
        "servo_caption": captions.get(servo.servo_id),
        "angle": int(servo.angle),
        "angle_unit": servo.angle.unit if isinstance(servo.angle, Angle) else None,
        "current_raw": servo.current,
        "temperature_raw": servo.temperature,
        "servo_type": servo.servo_type,
        "is_start": servo.is_start,
        "is_hold": servo.is_hold,
    }


def print_servos(servos: Iterable[Servo], *, as_json: bool, captions: Mapping[int, str]) -> None:
    """Print the reports of servos, with the stored `captions`; captions not read are left out."""
    if as_json:
        print_json({"servos": [servo_object(servo, captions) for servo in servos]})
        return
    is_named = any(captions.values())
    columns = ("servo", *(("caption",) if is_named else ()), "angle", "current (raw)", "temperature (raw)", "type")
    rows = [
        (
            servo.servo_id,
            *((captions.get(servo.servo_id),) if is_named else ()),
            servo.angle,
            servo.current,
            servo.temperature,
            servo.servo_type,
            servo.state,
        )
        for servo in servos
    ]
    print_table(Table((*columns, "state"), rows))
