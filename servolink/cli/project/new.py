"""`servolink project new`: a small project to begin with."""

from __future__ import annotations

import argparse
from pathlib import Path

from servolink.cli.main import OK
from servolink.cli.output import print_json, print_text
from servolink.cli.project.writing import add_force, write_new
from servolink.project.model import Project
from servolink.protocol.editing import Action

_SERVOS = 16
_MOST_SERVOS = 254


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink project new`."""
    parser.add_argument("file", type=Path, metavar="FILE", help="such as robot.servolink.json")
    parser.add_argument("--servos", type=_count, default=_SERVOS, metavar="N", help=f"servos 1 to N ({_SERVOS})")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Write a project with a caption for each servo and a pose with all of them at 0 degrees."""
    servo_ids = range(1, args.servos + 1)
    rest = Action.pose("Rest", dict.fromkeys(servo_ids, 0), seconds=1.0)
    project = Project.of(rest, captions={servo_id: f"servo {servo_id}" for servo_id in servo_ids})
    write_new(args, args.file, project)
    if args.json:
        print_json({"file": str(args.file), "servos": args.servos, "actions": len(project.actions)})
    else:
        print_text(f"{args.file}: written, with {args.servos} servos and action 1 'Rest'")
    return OK


def _count(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and 1 <= int(text) <= _MOST_SERVOS):
        raise argparse.ArgumentTypeError(f"{text!r} is no number of servos, 1 to {_MOST_SERVOS}")
    return int(text)
