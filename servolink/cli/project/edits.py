"""`servolink project scale-time`, `merge` and `rename`."""

from __future__ import annotations

import argparse
from pathlib import Path

from servolink.cli.arguments import number, whole_number
from servolink.cli.project.source import add_source, with_project
from servolink.cli.project.writing import add_output, write_edited
from servolink.project.checks.fix import fixed
from servolink.project.edits.find import find
from servolink.project.edits.merge import merged
from servolink.project.edits.rename import renamed, renamed_servo
from servolink.project.edits.scale import scaled
from servolink.project.files.file import load_project
from servolink.project.kinds import ACTION, KINDS
from servolink.project.model import Project

_TABLE = {"table": "joystick table"}


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `command`."""
    if command == "merge":
        parser.description = f"{parser.description} Where an id means two things, those of OTHER get new ids."
    add_source(parser)
    if command == "scale-time":
        parser.add_argument(
            "factor", type=number(1e-6, 1e6, "times"), metavar="FACTOR", help="2 takes twice as long, 0.5 half as long"
        )
        parser.add_argument(
            "actions", nargs="*", metavar="ACTION", help="caption or id; without any, everything and all pauses"
        )
    elif command == "merge":
        parser.add_argument("other", type=Path, metavar="OTHER", help="the project file that is added to it")
    else:
        parser.add_argument("kind", choices=("action", "macro", "table", "servo"), help="what to rename")
        parser.add_argument(
            "id",
            type=whole_number(-(2**31), 2**31 - 1),
            metavar="ID",
            help="its id, as `project show` shows it",
        )
        parser.add_argument("caption", metavar="CAPTION", help="the new caption, at most 32 bytes")
    add_output(parser)


def run(args: argparse.Namespace) -> int:
    """Write the edited project."""
    edit = {"scale-time": _scaled, "merge": _merged, "rename": _renamed}[args.project_command]

    def write(project: Project) -> int:
        result, changes = edit(args, project)
        return write_edited(args, project, result, changes)

    return with_project(args, write)


def _scaled(args: argparse.Namespace, project: Project) -> tuple[Project, list[str]]:
    actions = [find(project, name, (ACTION,)).action_id for name in args.actions]
    result, changes = scaled(project, args.factor, actions or None)
    result, fixes = fixed(result)
    return result, changes + fixes


def _merged(args: argparse.Namespace, project: Project) -> tuple[Project, list[str]]:
    return merged(project, load_project(args.other, exact=True))


def _renamed(args: argparse.Namespace, project: Project) -> tuple[Project, list[str]]:
    if args.kind == "servo":
        return renamed_servo(project, args.id, args.caption)
    kind = next(kind for kind in KINDS if kind.word == _TABLE.get(args.kind, args.kind))
    return renamed(project, kind, args.id, args.caption)
