"""`servolink project mirror`: left and right exchanged."""

from __future__ import annotations

import argparse
import re

from servolink.cli.main import refuse
from servolink.cli.project.source import add_source, with_project
from servolink.cli.project.writing import add_output, write_edited
from servolink.project.edits.find import find
from servolink.project.edits.mirror import Mirror, mirror_by_captions, mirrored
from servolink.project.kinds import ACTION, MACRO
from servolink.project.model import Project

_PAIR = re.compile(r"([0-9]{1,3})=([0-9]{1,3})", re.ASCII)
_HOW = """A servo that is built in as the mirror image of another turns the other way round, so each one takes the
opposite of its partner's angle, unless it is named in --same-sign. Servos without a partner stay as they are. The
partner of 'left knee' is 'right knee', of 'L knee' 'R knee', of 'l_knee' 'r_knee'; Chinese works too."""


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink project mirror`."""
    parser.description = f"{parser.description} {_HOW}"
    add_source(parser)
    parser.add_argument("records", nargs="+", metavar="NAME", help="caption or id of an action or a macro, action:3")
    parser.add_argument(
        "--map", type=_pairs, metavar="1=2,3=4", help="these pairs, not the captions; 5=5 for one that turns about"
    )
    parser.add_argument(
        "--same-sign", type=_servos, default=(), metavar="5,6", help="servos that take their partner's angle as it is"
    )
    add_output(parser)


def run(args: argparse.Namespace) -> int:
    """Write the project with the mirror images."""
    return with_project(args, lambda project: _mirror(args, project))


def _mirror(args: argparse.Namespace, project: Project) -> int:
    records = [find(project, name, (ACTION, MACRO)) for name in args.records]
    if args.map is None:
        mirror = mirror_by_captions(project, records, args.same_sign)
    else:
        mirror = Mirror(args.map, args.same_sign)
        if not any(step.servo_id in args.map for action in project.actions for step in action.steps):
            refuse(args, "no action moves a servo of --map")
    if strangers := [servo_id for servo_id in args.same_sign if servo_id not in mirror.partners]:
        refuse(args, f"servo {strangers[0]} of --same-sign has no partner")
    result, changes = mirrored(project, records, mirror)
    pairs = sorted((one, other) for one, other in mirror.partners.items() if one <= other)
    said = [f"pairs: {', '.join(f'{one}={other}' for one, other in pairs)}", *changes]
    return write_edited(args, project, result, said, pairs=pairs)


def _pairs(text: str) -> dict[int, int]:
    """Read pairs, and return them in both directions."""
    partners: dict[int, int] = {}
    for part in text.split(","):
        if (found := _PAIR.fullmatch(part.strip())) is None or max(map(int, found.groups())) > 0xFE:
            raise argparse.ArgumentTypeError(f"{part!r} is no pair of servos 0 to 254, as in 1=2")
        one, other = map(int, found.groups())
        for servo_id, partner in ((one, other), (other, one)):
            if partners.setdefault(servo_id, partner) != partner:
                raise argparse.ArgumentTypeError(f"servo {servo_id} has two partners in {text!r}")
    return partners


def _servos(text: str) -> tuple[int, ...]:
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isascii() and part.isdecimal() and int(part) <= 0xFE for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is no list of servos 0 to 254, as in 5,6")
    return tuple(map(int, parts))
