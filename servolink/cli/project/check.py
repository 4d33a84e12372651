"""`servolink project check`: what is wrong with a project."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from servolink.cli.arguments import whole_number
from servolink.cli.main import FAILED, OK, refuse
from servolink.cli.output import print_json, print_text
from servolink.cli.project.source import add_source, is_address, with_project
from servolink.project.checks.check import problems
from servolink.project.checks.fix import fixed
from servolink.project.checks.problem import Problem
from servolink.project.files.file import save_project
from servolink.project.model import Project

_IDS = re.compile(r"([0-9]{1,3})(?:-([0-9]{1,3}))?", re.ASCII)
_STYLES = {"error": "red", "warning": "yellow"}


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink project check`."""
    add_source(parser)
    parser.add_argument("--fix", action="store_true", help="repair in the file what has one right answer")
    parser.add_argument("--servos", type=_servo_ids, metavar="N", help="servos of the board: 16, or ids as in 1-8,11")
    parser.add_argument("--speed-cap", type=float, metavar="N", help="degrees per second that no servo may exceed")
    parser.add_argument("--memory", type=whole_number(0, 2**31 - 1), metavar="BYTES", help="memory of the board")


def run(args: argparse.Namespace) -> int:
    """Print a line for each problem: 0 if there is none left, else 1."""
    if args.fix and is_address(args.source):
        refuse(args, "--fix repairs files; `servolink export` writes one from a board")
    if args.speed_cap is not None and not args.speed_cap > 0:
        refuse(args, "--speed-cap takes degrees per second above 0")

    def check(project: Project) -> int:
        fixes: list[str] = []
        if args.fix:
            result, fixes = fixed(project)
            if fixes:
                save_project(Path(args.source), result)
                project = result
        found = problems(
            project,
            servo_ids=args.servos,
            speed_cap=args.speed_cap,
            memory=args.memory,
            caption_encoding=args.caption_encoding,
        )
        _print(args, found, fixes)
        return FAILED if found else OK

    return with_project(args, check)


def _print(args: argparse.Namespace, found: list[Problem], fixes: list[str]) -> None:
    if args.json:
        listed = [
            {"path": one.path, "text": one.text, "severity": one.severity, "fixable": one.fixable} for one in found
        ]
        print_json({"ok": not found, "problems": listed, "fixes": fixes})
        return
    for fix in fixes:
        print_text(f"fixed: {fix}", "green")
    for one in found:
        repair = " (--fix repairs it)" if one.fixable and not args.fix else ""
        print_text(f"{one.severity}: {one}{repair}", _STYLES[one.severity])
    print_text(f"{args.source}: {len(found) or 'no'} problem{'' if len(found) == 1 else 's'}")


def _servo_ids(text: str) -> frozenset[int]:
    """Read a number of servos, or a list of ids."""
    parts = [_IDS.fullmatch(part.strip()) for part in text.split(",")]
    found = frozenset(
        servo_id for part in parts if part for servo_id in range(int(part[1]), int(part[2] or part[1]) + 1)
    )
    if None in parts or not found or max(found) > 0xFE:
        raise argparse.ArgumentTypeError(f"{text!r} is neither a number of servos nor a list of ids, as in 1-8,11")
    return frozenset(range(1, int(text) + 1)) if text.isascii() and text.isdecimal() else found
