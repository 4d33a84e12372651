"""`servolink servos`: reports of the servos, shared with the commands that move servos."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Self

from msgspec import Struct

from servolink.cli.command import MOVE, Command, flag
from servolink.cli.command_session import KEEP_MODE, Interruption, is_answered, on_board
from servolink.cli.screen.output import Table, print_error
from servolink.cli.screen.result import CommandResult, Returned
from servolink.client import Board, Servo
from servolink.errors import NotFound, Rejected, RequestTimeout
from servolink.motion import Angle


@Command(
    "servos",
    MOVE,
    help="show angle, current and temperature of each servo",
    examples=("servos", "servos --adc", "servos --json"),
    options=(flag("--adc", "angles as raw ADC readings instead of degrees"), KEEP_MODE),
)
@on_board(lambda args: {"angle_unit": "adc" if args.adc else "degree"})
async def run(args: argparse.Namespace, board: Board, interruption: Interruption) -> Returned:
    """Print the servos."""
    return servos_returned(await reported(board, may_be_adc=True), await known_captions(board))


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


class ServoReport(Struct, frozen=True):
    """Report of a servo; null for an unread caption, and for an unknown unit.

    `doubt` says why the values cannot be true, such as "not measured"; it is empty for plausible ones.
    """

    servo_id: int
    servo_caption: str | None
    angle: int
    angle_unit: str | None
    current_raw: int
    temperature_raw: int
    servo_type: int
    is_start: bool
    is_hold: bool
    doubt: str

    @classmethod
    def of(cls, servo: Servo, captions: Mapping[int, str]) -> Self:
        """Return the report of `servo`; its caption is None unless in `captions`."""
        caption, unit = captions.get(servo.servo_id), servo.angle.unit if isinstance(servo.angle, Angle) else None
        sensors = servo.current, servo.temperature, servo.servo_type
        return cls(
            servo.servo_id, caption, int(servo.angle), unit, *sensors, servo.is_start, servo.is_hold, servo.doubt
        )


class ServoReports(CommandResult, frozen=True):
    """JSON of `servos`, `servo list`, `servo start`, `servo hold`, `servo release`, `stop` and `release`."""

    servos: list[ServoReport]


def servos_returned(servos: Iterable[Servo], captions: Mapping[int, str], *above: str) -> Returned:
    """Return the reports of servos, with the stored `captions`; captions not read are left out."""
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
    table = Table((*columns, "state"), rows)
    return Returned(ServoReports([ServoReport.of(servo, captions) for servo in servos]), [*above, table])
