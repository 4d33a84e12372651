"""`servolink project preflight`: what is too fast or goes too far."""

from __future__ import annotations

import argparse
import re

from servolink.cli.main import FAILED, OK, refuse
from servolink.cli.output import print_json, print_text
from servolink.cli.project.source import add_source, with_project
from servolink.project.checks.preflight import preflight
from servolink.project.edits.find import find
from servolink.project.kinds import ACTION, MACRO
from servolink.project.model import Project

_NUMBER = r"[+-]?[0-9]{1,5}(?:\.[0-9]{1,3})?"
_SERVO_LIMIT = re.compile(rf"([0-9]{{1,3}})=({_NUMBER}):({_NUMBER})", re.ASCII)


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink project preflight`."""
    add_source(parser)
    parser.add_argument("record", nargs="?", metavar="NAME", help="only this action or macro, and what it calls")
    parser.add_argument("--speed-cap", type=float, metavar="N", help="degrees per second that no servo may exceed")
    parser.add_argument(
        "--limit", nargs=2, type=float, metavar=("LOW", "HIGH"), help="angles of all servos, in degrees"
    )
    parser.add_argument(
        "--servo-limit",
        action="append",
        default=[],
        type=_servo_limit,
        metavar="SERVO=LOW:HIGH",
        help="angles of one servo, as in 3=-45:90; may be given again",
    )
    parser.add_argument(
        "--from", dest="start", metavar="ACTION", help="the pose that the servos are in before, such as Rest"
    )


def run(args: argparse.Namespace) -> int:
    """Print what is too fast or goes too far: 0 if nothing does, else 1."""
    if args.speed_cap is None and not args.limit and not args.servo_limit:
        refuse(args, "give --speed-cap, --limit or --servo-limit: this is what movements are compared with")
    if args.speed_cap is not None and not args.speed_cap > 0:
        refuse(args, "--speed-cap takes degrees per second above 0")
    if args.limit and not args.limit[0] <= args.limit[1]:
        refuse(args, "--limit takes the lower angle first, as in --limit -90 90")
    for_all = tuple(args.limit) if args.limit else None

    def examine(project: Project) -> int:
        record = find(project, args.record, (ACTION, MACRO)) if args.record else None
        pose = find(project, args.start, (ACTION,)) if args.start else None
        limits = dict.fromkeys(range(0x100), for_all) if for_all else {}
        found = preflight(
            project,
            None if record is None else [record],
            speed_cap=args.speed_cap,
            angle_limits=limits | dict(args.servo_limit),
            start=None if pose is None else {step.servo_id: step.degree for step in pose.steps},
        )
        if args.json:
            print_json({"ok": not found, "findings": [{"path": one.path, "text": one.text} for one in found]})
        else:
            for one in found:
                print_text(str(one))
            print_text(f"{len(found) or 'no'} finding{'' if len(found) == 1 else 's'}")
        return FAILED if found else OK

    return with_project(args, examine)


def _servo_limit(text: str) -> tuple[int, tuple[float, float]]:
    found = _SERVO_LIMIT.fullmatch(text)
    if found is None or int(found[1]) > 0xFE or float(found[2]) > float(found[3]):
        raise argparse.ArgumentTypeError(f"{text!r} is not SERVO=LOW:HIGH, as in 3=-45:90")
    return int(found[1]), (float(found[2]), float(found[3]))
