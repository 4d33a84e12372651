"""`servolink project new`, `mirror`, `scale-time`, `merge`, `rename` and `schema`."""

from __future__ import annotations

import argparse

from servolink.cli.arguments import SERVO_NAME, file_path, new_file, number, or_caption, whole_number
from servolink.cli.command import Command, option
from servolink.cli.projects.source import FORCE, OUTPUT, SOURCE, with_project, write_edited, write_new
from servolink.cli.screen.output import counted
from servolink.cli.screen.result import CommandResult, Ending, Returned
from servolink.cli.usage import usage_error
from servolink.errors import quote
from servolink.project import (
    Mirror,
    Project,
    ProjectFile,
    build_project,
    fix_project,
    load_project,
    merge_projects,
    mirror_by_captions,
    mirror_project,
    rename_record,
    rename_servo,
    scale_project,
)
from servolink.protocol import ACTION, MACRO, RECORD_TYPES, Action
from servolink.support import ExitCode


def _scaled(args: argparse.Namespace, project: Project) -> tuple[Project, list[str]]:
    actions = [project.find(name, (ACTION,)).action_id for name in args.actions]
    result, changes = scale_project(project, args.factor, actions or None)
    result, fixes = fix_project(result)
    return result, changes + fixes


def run_edit(args: argparse.Namespace) -> Ending:
    """Write the edited project."""
    return with_project(args, lambda project: write_edited(args, project, *args.edit(args, project)))


PROJECT_SCALE_TIME = Command(
    "project scale-time",
    help="make actions, or everything, slower or faster",
    examples=(
        "project scale-time robot.servolink.json 2 -o slow.servolink.json",
        "project scale-time robot.servolink.json 0.5 Bow --in-place",
    ),
    options=(
        *SOURCE,
        option("factor", "FACTOR", "2 takes twice as long, 0.5 half as long", number(1e-6, 1e6, "times")),
        option("actions", "ACTION", "caption or id; without any, everything and all pauses", nargs="*", default=[]),
        *OUTPUT,
    ),
    defaults={"edit": _scaled},
    takes_board=False,
)(run_edit)


def _merged(args: argparse.Namespace, project: Project) -> tuple[Project, list[str]]:
    return merge_projects(project, load_project(args.other, unchecked=True))


PROJECT_MERGE = Command(
    "project merge",
    help="merge two projects into one",
    details="If an id means two different records, the one of OTHER gets a new id.",
    examples=("project merge robot.servolink.json other.json -o all.json",),
    options=(*SOURCE, option("other", "OTHER", "the project file to add to it", file_path), *OUTPUT),
    defaults={"edit": _merged},
    takes_board=False,
)(run_edit)


def _renamed(args: argparse.Namespace, project: Project) -> tuple[Project, list[str]]:
    if args.kind == "servo":
        return rename_servo(project, project.find_servo(args.record), args.caption)
    kind = next(kind for kind in RECORD_TYPES if kind.label.endswith(args.kind))
    is_id = isinstance(args.record, int)
    record = kind.record_class(args.record) if is_id else project.find(args.record, (kind,))
    return rename_record(project, record, args.caption)


PROJECT_RENAME = Command(
    "project rename",
    help="give an action, a macro, a table or a servo another caption",
    examples=("project rename robot.servolink.json action 1 Hello --in-place",),
    options=(
        *SOURCE,
        option("kind", "action|macro|table|servo", "what to rename"),
        option(
            "record",
            "NAME",
            "its caption or id, which `project show` prints",
            or_caption(whole_number(-(2**31), 2**31 - 1)),
        ),
        option("caption", "CAPTION", "the new caption, at most 32 bytes"),
        *OUTPUT,
    ),
    defaults={"edit": _renamed},
    takes_board=False,
)(run_edit)


_HOW = (
    "A servo mounted as the mirror image of another turns the other way, so each servo gets the opposite of its "
    "partner's angle, unless --same-sign names it. Servos without a partner keep their angle. The partner of 'left "
    "knee' is 'right knee', of 'L knee' 'R knee', of 'l_knee' 'r_knee', of '左膝' '右膝'."
)


def _pairs(text: str) -> list[tuple[int | str, int | str]]:
    """Return the pairs in a text such as `1=2,hip=3`."""
    pairs = []
    for part in text.split(","):
        one, separator, other = part.partition("=")
        if not separator:
            raise argparse.ArgumentTypeError(f"must list pairs of servos, such as 1=2,hip=3, not {quote(part)}")
        pairs.append((SERVO_NAME(one.strip()), SERVO_NAME(other.strip())))
    return pairs


def _servos(text: str) -> tuple[int | str, ...]:
    return tuple(SERVO_NAME(part.strip()) for part in text.split(","))


@Command(
    "project mirror",
    help="add actions and macros with left and right exchanged",
    details=f"{_HOW}",
    examples=("project mirror robot.servolink.json Bow --map 1=2 -o both.json",),
    options=(
        *SOURCE,
        option("records", "NAME", "actions or macros: captions, ids, or as in action:3", nargs="+"),
        option(
            "--map",
            "1=2,hip=3",
            "pairs, ids or captions, in place of those that captions suggest; 5=5 gets the opposite angle",
            _pairs,
        ),
        option(
            "--same-sign",
            "5,hip",
            "servos, by id or caption, that take their partner's angle unchanged",
            _servos,
            default=(),
        ),
        *OUTPUT,
    ),
    takes_board=False,
)
def run_mirror(args: argparse.Namespace) -> Ending:
    """Write the project with the mirror images."""
    return with_project(args, lambda project: _mirror(args, project))


def _mirror(args: argparse.Namespace, project: Project) -> Returned:
    records = [project.find(name, (ACTION, MACRO)) for name in args.records]
    same_sign = [project.find_servo(servo) for servo in args.same_sign]
    if args.map is None:
        mirror = mirror_by_captions(project, records, same_sign)
    else:
        mirror = Mirror(_partners(args, project), same_sign)
        if not any(step.servo_id in mirror.partners for action in project.actions for step in action.steps):
            usage_error(args, "no action moves a servo of --map")
    if strangers := [servo_id for servo_id in same_sign if servo_id not in mirror.partners]:
        usage_error(args, f"servo {strangers[0]} of --same-sign has no partner")
    result, changes = mirror_project(project, records, mirror)
    pairs = sorted((one, other) for one, other in mirror.partners.items() if one <= other)
    lines = [f"pairs: {', '.join(f'{one}={other}' for one, other in pairs)}", *changes]
    return write_edited(args, project, result, lines, pairs=pairs)


def _partners(args: argparse.Namespace, project: Project) -> dict[int, int]:
    """Return the pairs of `--map` by id, in both directions."""
    partners: dict[int, int] = {}
    for pair in args.map:
        one, other = (project.find_servo(servo) for servo in pair)
        for servo_id, partner in ((one, other), (other, one)):
            if partners.setdefault(servo_id, partner) != partner:
                usage_error(args, f"servo {servo_id} has two partners in --map")
    return partners


class ProjectMade(CommandResult, frozen=True):
    """JSON of `project new`: how many servos and actions the file has."""

    file: str
    servos: int
    actions: int


_SERVOS = 16
_MOST_SERVOS = 254


def _count(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and 1 <= int(text) <= _MOST_SERVOS):
        raise argparse.ArgumentTypeError(f"must be a number of servos from 1 to {_MOST_SERVOS}, not {quote(text)}")
    return int(text)


@Command(
    "project new",
    help="write a small project to start with",
    examples=("project new arm.servolink.json --servos 6",),
    options=(
        option("file", "FILE", "such as robot.servolink.json", new_file),
        option("--servos", "N", f"servos 1 to N ({_SERVOS})", _count, default=_SERVOS),
        *FORCE,
    ),
    takes_board=False,
)
def run_new(args: argparse.Namespace) -> Returned:
    """Write a project with a caption for each servo, and a pose with all servos at 0 degrees."""
    servo_ids = range(1, args.servos + 1)
    rest = Action.pose("Rest", dict.fromkeys(servo_ids, 0), seconds=1.0)
    project = build_project(rest, captions={servo_id: f"servo {servo_id}" for servo_id in servo_ids})
    write_new(args, args.file, ProjectFile(project))
    text = f"{args.file}: written, with {counted(args.servos, 'servo')} and action 1 'Rest'"
    return Returned(ProjectMade(str(args.file), args.servos, len(project.actions)), text)


@Command(
    "project schema", help="print the JSON Schema of project files", examples=("project schema",), takes_board=False
)
def run_schema(args: argparse.Namespace) -> int:
    """Print the schema, which is JSON with `--json` and without."""
    print(ProjectFile.schema_text(), end="")
    return ExitCode.OK
