"""`servolink project check` and `preflight`: find the problems of a project, and movements beyond limits."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator

from servolink.boards import ProfileFile, ProfileInUse
from servolink.cli.arguments import SERVO_NAME, whole_number
from servolink.cli.command import Command, flag, option
from servolink.cli.projects.source import SOURCE, is_address, with_project
from servolink.cli.screen.output import counted
from servolink.cli.screen.result import CommandResult, Ending, Part, Returned
from servolink.cli.usage import usage_error
from servolink.errors import quote
from servolink.motion import INTERVAL_UNIT
from servolink.project import Diagnostic, Project, ProjectFile, fix_project, preflight, validate_project
from servolink.protocol import ACTION, ALL_SERVOS, MACRO
from servolink.support import ExitCode

_IDS = re.compile(r"([0-9]{1,3})(?:-([0-9]{1,3}))?", re.ASCII)
_STYLES = {"error": "red", "warning": "yellow"}


def _servo_ids(text: str) -> frozenset[int]:
    """Read a number of servos, or a list of ids."""
    parts = [_IDS.fullmatch(part.strip()) for part in text.split(",")]
    found = frozenset(
        servo_id for part in parts if part for servo_id in range(int(part[1]), int(part[2] or part[1]) + 1)
    )
    if None in parts or not found or max(found) > 0xFE:
        raise argparse.ArgumentTypeError(
            f"must be a number of servos, or a list of ids as in 1-8,11, not {quote(text)}"
        )
    return frozenset(range(1, int(text) + 1)) if text.isascii() and text.isdecimal() else found


@Command(
    "project check",
    help="find what is wrong with a project, and repair it",
    examples=("project check robot.servolink.json", "project check robot.servolink.json --fix"),
    options=(
        *SOURCE,
        flag("--fix", "repair in the file what has one right solution"),
        option("--servos", "N", "servos of the board: 16, or ids as in 1-8,11", _servo_ids),
        option("--speed-cap", "N", "degrees per second that no servo may exceed", float),
        option("--memory", "BYTES", "memory of the board", whole_number(0, 2**31 - 1)),
    ),
    takes_board=False,
)
def run_check(args: argparse.Namespace) -> Ending:
    """Print a line for each problem; return 0 if none is left, else 1."""
    if args.fix and is_address(args.source):
        usage_error(args, "--fix repairs files; `servolink export` writes one from a board")
    if args.speed_cap is not None and not args.speed_cap > 0:
        usage_error(args, "--speed-cap must be above 0 degrees per second")

    def check(project: Project) -> Returned:
        fixes: list[str] = []
        if args.fix:
            result, fixes = fix_project(project)
            if fixes:
                unchecked = ProjectFile.read(args.source, unchecked=True).unchecked
                ProjectFile(result, unchecked=unchecked).write(args.source)
                project = result
        found = validate_project(
            project,
            servo_ids=args.servos,
            speed_cap=args.speed_cap,
            memory=args.memory,
            caption_encoding=args.caption_encoding or "utf-8",
        )
        code = ExitCode.FAILED if found else ExitCode.OK
        return Returned(ProjectChecked(not found, found, fixes), _text(args, found, fixes), code)

    return with_project(args, check)


class ProjectChecked(CommandResult, frozen=True):
    """JSON of `project check`; `fixes` are the repairs of --fix."""

    ok: bool
    problems: list[Diagnostic]
    fixes: list[str]


def _text(args: argparse.Namespace, found: list[Diagnostic], fixes: list[str]) -> Iterator[Part]:
    yield from ((f"fixed: {fix}", "green") for fix in fixes)
    for one in found:
        repair = " (--fix repairs it)" if one.fixable and not args.fix else ""
        yield f"{one.severity}: {one}{repair}", _STYLES[one.severity]
    yield f"{args.source}: {counted(len(found), 'problem') if found else 'no problems'}"


class ProjectPreflight(CommandResult, frozen=True):
    """JSON of `project preflight`: each finding with place and text."""

    ok: bool
    findings: list[dict[str, str]]


_NUMBER = r"[+-]?[0-9]{1,5}(?:\.[0-9]{1,3})?"
_SERVO_LIMIT = re.compile(rf"(.+)=({_NUMBER}):({_NUMBER})", re.DOTALL)


def _servo_limit(text: str) -> tuple[int | str, tuple[float, float]]:
    """Return servo and angle limits in degrees from SERVO=LOW:HIGH, for argparse."""
    found = _SERVO_LIMIT.fullmatch(text)
    if found is None or float(found[2]) > float(found[3]):
        raise argparse.ArgumentTypeError(f"must have the form SERVO=LOW:HIGH, such as 3=-45:90, not {quote(text)}")
    return SERVO_NAME(found[1]), (float(found[2]), float(found[3]))


@Command(
    "project preflight",
    help="find movements that are too fast or go too far",
    examples=("project preflight robot.servolink.json --speed-cap 120",),
    options=(
        *SOURCE,
        option("record", "NAME", "check a single action or macro, with everything run by the macro", nargs="?"),
        option("--speed-cap", "N", "degrees per second that no servo may exceed", float),
        option("--limit", ("LOW", "HIGH"), "angles of all servos, in degrees", float, nargs=2),
        option(
            "--servo-limit",
            "SERVO=LOW:HIGH",
            "angle limits of a servo, by id or caption, such as hip=-45:90; repeatable",
            _servo_limit,
            action="append",
            default=[],
        ),
        option("--profile", "NAME", "the limits kept for this board, as in `servolink board show`"),
        option("--from", "ACTION", "the action whose pose the servos start from, such as Rest", dest="start"),
    ),
    takes_board=False,
)
def run_preflight(args: argparse.Namespace) -> Ending:
    """Print the movements that are too fast or go too far; return 0 if there are none, else 1."""
    if args.speed_cap is None and not args.limit and not args.servo_limit and args.profile is None:
        usage_error(args, "give --profile, --speed-cap, --limit or --servo-limit, with which movements are compared")
    if args.speed_cap is not None and not args.speed_cap > 0:
        usage_error(args, "--speed-cap must be above 0 degrees per second")
    if args.limit and not args.limit[0] <= args.limit[1]:
        usage_error(args, "--limit needs the lower angle first, as in --limit -90 90")
    for_all = tuple(args.limit) if args.limit else None
    profile = None if args.profile is None else _profile(args)

    def examine(project: Project) -> Returned:
        record = project.find(args.record, (ACTION, MACRO)) if args.record else None
        pose = project.find(args.start, (ACTION,)) if args.start else None
        limits = dict.fromkeys(range(ALL_SERVOS), for_all) if for_all else {}
        limits |= {project.find_servo(servo): allowed for servo, allowed in args.servo_limit}
        found = preflight(
            project,
            None if record is None else [record],
            speed_cap=args.speed_cap,
            angle_limits=limits,
            limits=None if profile is None else profile.limits,
            interval_unit=(profile and profile.settings.interval_unit) or INTERVAL_UNIT,
            start=None if pose is None else {step.servo_id: step.degree for step in pose.steps},
        )
        text = [*map(str, found), counted(len(found), "finding") if found else "no findings"]
        value = ProjectPreflight(not found, [{"path": one.path, "text": one.text} for one in found])
        return Returned(value, text, ExitCode.FAILED if found else ExitCode.OK)

    return with_project(args, examine)


def _profile(args: argparse.Namespace) -> ProfileInUse:
    """Return the profile named by `--profile`; a missing profile is wrong usage."""
    if (profile := ProfileFile(args.profile).load()) is None:
        usage_error(args, f"{quote(args.profile)} has no profile; `servolink board` lists those that there are")
    return ProfileInUse(args.profile, profile)
