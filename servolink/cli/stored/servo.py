"""`servolink servo`: start, hold and release servos, set the unit of their angles, name and trim them."""

from __future__ import annotations

import argparse
from typing import Any

from msgspec.structs import replace

from servolink.cli.arguments import MOST_TRIM, SERVO_NAME, whole_number
from servolink.cli.command import Command, option
from servolink.cli.command_session import UNTOUCHED, Interruption, on_board, run_with_board
from servolink.cli.motion.servo_output import servos_returned
from servolink.cli.screen.result import CommandResult, Ending, Returned
from servolink.cli.stored.change import change_parameters
from servolink.client import Board, find_servos
from servolink.errors import NotFound
from servolink.protocol import ALL_SERVOS

_ANY = "id or caption, or all"


class AngleUnitSet(CommandResult, frozen=True):
    """JSON of `servo unit`; the id 255 stands for all servos."""

    servo_ids: list[int]
    angle_unit: str


_SERVOS = (option("servos", "SERVO", _ANY, SERVO_NAME, nargs="+"),)


@on_board(state="no servo was changed")
async def run_state(args: argparse.Namespace, board: Board, interruption: Interruption) -> Returned:
    """Start servos, or stop and hold servos, and print the reports of the servos afterwards."""
    servo_ids, captions = await _find_servos(board, args.servos)
    for servo_id in servo_ids:
        interruption.state = f"servos may have been {args.done}; `servolink servos` shows them"
        await board.set_servo(servo_id, start=args.start, hold=True)
    return servos_returned(await board.servos(), captions)


SERVO_START = Command(
    "servo start",
    help="start servos, which then hold and obey movements",
    details="A servo may move to where it was sent last.",
    examples=("servo start 1 2",),
    options=(*_SERVOS,),
    defaults={"start": True, "done": "started"},
)(run_state)
SERVO_HOLD = Command(
    "servo hold",
    help="stop and hold servos in place",
    examples=("servo hold 1", "servo hold all"),
    options=(*_SERVOS,),
    defaults={"start": False, "done": "stopped and held"},
)(run_state)


_SERVO = (option("servo", "SERVO", "id or caption", SERVO_NAME),)


@Command(
    "servo unit",
    help="set the unit of angles",
    details="Commands that read or move servos set the unit that they need themselves.",
    examples=("servo unit 1 adc", "servo unit all degree"),
    options=(*_SERVOS, option("unit", "degree|adc", "degrees or raw ADC readings")),
)
@on_board(state="no unit was set", angle_unit=None)
async def run_unit(args: argparse.Namespace, board: Board, interruption: Interruption) -> Returned:
    """Set the unit of angles."""
    servo_ids, _ = await _find_servos(board, args.servos)
    for servo_id in servo_ids:
        interruption.state = "units of angles may have been set"
        await board.set_angle_unit(args.unit, servo_id)
    which = "all servos" if ALL_SERVOS in servo_ids else ", ".join(f"servo {one}" for one in servo_ids)
    text = f"{which}: angles are in {'degrees' if args.unit == 'degree' else 'raw ADC readings'}"
    return Returned(AngleUnitSet(servo_ids, args.unit), text)


async def _find_servos(
    board: Board, servos: list[int | str], *, takes_all: bool = True
) -> tuple[list[int], dict[int, str]]:
    """Return the ids of servos, 255 for all, and the captions read on the way, by id.

    Raise NotFound, before anything is changed, for a servo that is missing.
    """
    found, captions = await find_servos(board, servos)
    there = await board.servo_ids()
    allowed = {*there, ALL_SERVOS} if takes_all else {*there}
    if missing := [servo_id for servo_id in found if servo_id not in allowed]:
        raise NotFound(f"the board has no servo {missing[0]}; no servo was changed")
    if not there:
        raise NotFound("the board has no servos")
    return found, captions


@Command(
    "servo rename",
    help="give a servo a caption",
    examples=("servo rename 3 hip",),
    options=(*_SERVO, option("caption", "CAPTION", "the new caption, at most 32 bytes")),
    defaults={"yes": True},
)
def run_rename(args: argparse.Namespace) -> int:
    """Give a servo another caption."""
    return _change(args, servo_caption=args.caption)


@Command(
    "servo trim",
    help="set the angle correction of a servo",
    examples=("servo trim 3 +4", "servo trim 3 -2 --json"),
    options=(
        *_SERVO,
        option(
            "degrees",
            "DEGREES",
            "the new correction, -180 to 180; 0 for none. It replaces the old one",
            whole_number(-MOST_TRIM, MOST_TRIM),
        ),
    ),
    defaults={"yes": True},
)
def run_trim(args: argparse.Namespace) -> int:
    """Set the angle correction of a servo."""
    return _change(args, adjusted_degree=args.degrees)


def _change(args: argparse.Namespace, **fields: Any) -> int:
    """Change the stored settings of a servo."""

    async def talk(board: Board, interruption: Interruption) -> Ending:
        [servo_id], _ = await _find_servos(board, [args.servo], takes_all=False)
        return await change_parameters(args, board, interruption, {servo_id: lambda one: replace(one, **fields)})

    return run_with_board(args, talk, greet=False, state=UNTOUCHED)
