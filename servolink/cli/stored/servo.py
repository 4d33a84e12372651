"""`servolink servo`: start, hold and release servos, set the unit of their angles, name and trim them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from servolink.cli.arguments import MOST_TRIM, SERVO_NAME, whole_number
from servolink.cli.commands import STORED, Command
from servolink.cli.main import OK
from servolink.cli.parser import Parser

if TYPE_CHECKING:
    from servolink.client.board import Board


def _command(place: str, text: str, *examples: str) -> Command:
    return Command(STORED, place, text, tuple(f"servo {one}" for one in examples))


COMMANDS = {
    "list": _command(
        "motion.servos:configure", "show angle, current and temperature of each servo", "list", "list --json"
    ),
    "start": _command("stored.servo:configure_start", "start servos, which then hold and obey movements", "start 1 2"),
    "hold": _command("stored.servo:configure_hold", "stop servos where they are, and hold them", "hold 1", "hold all"),
    "release": _command("motion.move:configure_release", "let servos go limp", "release 1 2 --yes"),
    "unit": _command("stored.servo:configure_unit", "set the unit of angles", "unit 1 adc", "unit all degree"),
    "rename": _command("stored.servo:configure_rename", "give a servo a caption", "rename 3 hip"),
    "trim": _command(
        "stored.servo:configure_trim", "set the angle correction of a servo", "trim 3 +4", "trim 3 -2 --json"
    ),
}
"""As `servolink.cli.commands.COMMANDS`."""

_ANY = "id or caption, or all"


def configure(parser: Parser) -> None:
    """Add the commands of `servolink servo`."""
    parser.add_commands(COMMANDS, "verb")


def configure_start(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink servo start`."""
    parser.set_defaults(run=run_state, start=True, done="started")
    parser.description = f"{parser.description}\n\nA servo may move to where it was sent last."
    _add_servos(parser)


def configure_hold(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink servo hold`."""
    parser.set_defaults(run=run_state, start=False, done="stopped and held")
    _add_servos(parser)


def configure_unit(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink servo unit`."""
    parser.set_defaults(run=run_unit)
    parser.description = (
        f"{parser.description}\n\nCommands that read or move servos set the unit that they need themselves."
    )
    _add_servos(parser)
    parser.add_argument("unit", choices=("degree", "adc"), metavar="degree|adc", help="degrees or raw ADC readings")


def configure_rename(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink servo rename`."""
    parser.set_defaults(run=run_rename, yes=True)
    _add_servo(parser)
    parser.add_argument("caption", metavar="CAPTION", help="the new caption, at most 32 bytes")


def configure_trim(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink servo trim`."""
    parser.set_defaults(run=run_trim, yes=True)
    _add_servo(parser)
    parser.add_argument(
        "degrees",
        type=whole_number(-MOST_TRIM, MOST_TRIM),
        metavar="DEGREES",
        help="the new correction, -180 to 180; 0 for none. It replaces the old one",
    )


def _add_servos(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("servos", nargs="+", type=SERVO_NAME, metavar="SERVO", help=_ANY)


def _add_servo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("servo", type=SERVO_NAME, metavar="SERVO", help="id or caption")


def run_state(args: argparse.Namespace) -> int:
    """Start servos, or stop and hold them, and print what the servos then report."""
    from servolink.cli.motion.servos import print_servos
    from servolink.cli.session import Interruption, run_with_board

    async def talk(board: Board, interruption: Interruption) -> int:
        servo_ids, captions = await _find_servos(board, args.servos)
        for servo_id in servo_ids:
            interruption.state = f"servos may have been {args.done}; `servolink servos` shows them"
            await board.set_servo(servo_id, start=args.start, hold=True)
        print_servos(await board.servos(), as_json=args.json, captions=captions)
        return OK

    return run_with_board(args, talk, state="no servo was changed")


def run_unit(args: argparse.Namespace) -> int:
    """Set the unit of angles."""
    from servolink.cli.screen.output import print_json, print_text
    from servolink.cli.session import Interruption, run_with_board
    from servolink.protocol.servos import ALL_SERVOS

    async def talk(board: Board, interruption: Interruption) -> int:
        servo_ids, _ = await _find_servos(board, args.servos)
        for servo_id in servo_ids:
            interruption.state = "units of angles may have been set"
            await board.set_angle_unit(args.unit, servo_id)
        if args.json:
            print_json({"servo_ids": servo_ids, "angle_unit": args.unit})
        else:
            which = "all servos" if ALL_SERVOS in servo_ids else ", ".join(f"servo {one}" for one in servo_ids)
            print_text(f"{which}: angles are in {'degrees' if args.unit == 'degree' else 'raw ADC readings'}")
        return OK

    return run_with_board(args, talk, state="no unit was set", angle_unit=None)


async def _find_servos(
    board: Board, servos: list[int | str], *, takes_all: bool = True
) -> tuple[list[int], dict[int, str]]:
    """Return the ids of servos, 255 for all, and the captions that were read for that, by id.

    Raise NotFound, before anything is changed, for a servo that is missing.
    """
    from servolink.client.names import find_servos
    from servolink.errors import NotFound
    from servolink.protocol.servos import ALL_SERVOS

    found, captions = await find_servos(board, servos)
    there = await board.servo_ids()
    allowed = {*there, ALL_SERVOS} if takes_all else {*there}
    if missing := [servo_id for servo_id in found if servo_id not in allowed]:
        raise NotFound(f"the board has no servo {missing[0]}; no servo was changed")
    if not there:
        raise NotFound("the board has no servos")
    return found, captions


def run_rename(args: argparse.Namespace) -> int:
    """Give a servo another caption."""
    return _change(args, servo_caption=args.caption)


def run_trim(args: argparse.Namespace) -> int:
    """Set the angle correction of a servo."""
    return _change(args, adjusted_degree=args.degrees)


def _change(args: argparse.Namespace, **fields: Any) -> int:
    """Change what the board stores for one servo."""
    from msgspec.structs import replace

    from servolink.cli.session import UNTOUCHED, Interruption, run_with_board
    from servolink.cli.stored.change import change_parameters

    async def talk(board: Board, interruption: Interruption) -> int:
        [servo_id], _ = await _find_servos(board, [args.servo], takes_all=False)
        return await change_parameters(args, board, interruption, {servo_id: lambda one: replace(one, **fields)})

    return run_with_board(args, talk, greet=False, state=UNTOUCHED)
