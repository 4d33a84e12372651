"""`servolink servos`: what the servos report."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from typing import Any

from servolink.cli.main import OK
from servolink.cli.output import Table, print_json, print_table
from servolink.cli.session import Interruption, converse
from servolink.client.angles import Angle
from servolink.client.board import Board
from servolink.client.servos import Servo


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink servos`."""
    parser.add_argument("--adc", action="store_true", help="angles as raw ADC readings instead of degrees")


def run(args: argparse.Namespace) -> int:
    """Print the servos."""

    async def talk(board: Board, interruption: Interruption) -> int:
        captions = {servo.servo_id: servo.servo_caption for servo in await board.servo_parameters()}
        print_servos(await board.servos(), as_json=args.json, captions=captions)
        return OK

    return converse(args, talk, angle_unit="adc" if args.adc else "degree")


def _servo_object(servo: Servo, captions: Mapping[int, str] | None) -> dict[str, Any]:
    return {
        "servo_id": servo.servo_id,
        **({} if captions is None else {"servo_caption": captions.get(servo.servo_id)}),
        "angle": int(servo.angle),
        "angle_unit": servo.angle.unit if isinstance(servo.angle, Angle) else None,
        "current": servo.current,
        "temperature": servo.temperature,
        "servo_type": servo.servo_type,
        "is_start": servo.is_start,
        "is_hold": servo.is_hold,
    }


def _state_of(servo: Servo) -> str:
    """Return in a word what a servo would do with a movement."""
    return "released" if not servo.is_hold else "stopped" if not servo.is_start else "ready"


def print_servos(servos: Iterable[Servo], *, as_json: bool, captions: Mapping[int, str] | None = None) -> None:
    """Print what servos report, with the `captions` that are stored for them."""
    if as_json:
        print_json({"servos": [_servo_object(servo, captions) for servo in servos]})
        return
    named = captions if captions and any(captions.values()) else None
    columns = ("servo", *(() if named is None else ("caption",)), "angle", "current (raw)", "temperature (raw)", "type")
    rows = [
        (
            servo.servo_id,
            *(() if named is None else (named.get(servo.servo_id),)),
            servo.angle,
            servo.current,
            servo.temperature,
            servo.servo_type,
            _state_of(servo),
        )
        for servo in servos
    ]
    print_table(Table((*columns, "state"), rows))
