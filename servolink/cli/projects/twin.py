"""`servolink twin`: the body of a project's figure, with physics."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import asdict

from servolink.cli.arguments import new_file, not_empty
from servolink.cli.command import PROJECTS, Command, flag, one_of, option
from servolink.cli.projects.source import FORCE, write_edited
from servolink.cli.screen.output import Table, counted, print_json, print_result, print_table, print_text
from servolink.errors import ProjectError
from servolink.files import reason, write_atomically
from servolink.project.model import Project
from servolink.project.record_lookup import by_type, find, name_of
from servolink.protocol.record_types import ACTION, MACRO, type_of
from servolink.script import FAILED, OK

if TYPE_CHECKING:  # and imported late: `--help` needs none of it
    from servolink.twin.body import Body
    from servolink.twin.forecast import Forecast
    from servolink.twin.trial import Fall

FILE = option("source", "FILE", "a project file with a figure", not_empty)
"""Argument with the project whose figure has the body."""

TWIN = Command(
    "twin",
    PROJECTS,
    help="give the robot of a project a body with physics",
    details="The body follows from the figure of the project; masses and servos can be written there.",
    examples=("twin check robot.servolink.json", "twin model robot.servolink.json -o robot.xml"),
    takes_board=False,
)


@Command(
    "twin check",
    help="find out whether the robot stands or falls, before it moves",
    details=(
        "Each macro is run from the pose with all servos at 0, on the body and on bodies with 20 % more or less mass, "
        "stiffness and friction. The verdict is 'stands' or 'falls' if that is so for all of them, or else 'uncertain'."
    ),
    examples=("twin check robot.servolink.json", "twin check robot.servolink.json --all"),
    options=(
        FILE,
        one_of(
            option("--macro", "NAME", "check one macro or action: caption, id, or as in action:3"),
            flag("--all", "check all actions too, each on its own"),
        ),
        option("--picture", "OUT", "write the moment of the first fall, or of the largest lean, as PNG", new_file),
        *FORCE,
    ),
    takes_board=False,
)
def run_check(args: argparse.Namespace) -> int:
    """Print a forecast for each record; return 1 if the robot falls in one, else 0."""
    from servolink.twin.body import read_body
    from servolink.twin.forecast import Verdict, forecast

    project, body = read_body(args.source)
    by_type(project)  # refuses duplicate ids: the board would run either record
    if args.macro is not None:
        records = [find(project, args.macro, (MACRO, ACTION))]
    else:
        records = [*(project.actions if args.all else ()), *project.macros]
    found = forecast(project, body, records, processes=os.cpu_count() or 1)
    if args.json:
        ok = all(one.verdict is not Verdict.FALLS for one in found)
        print_json({"ok": ok, "assumptions": body.assumptions, "forecasts": [one.as_dict() for one in found]})
    else:
        _print(found, body.assumptions)
    if args.picture is not None and found:
        _write_picture(args, project, body, found)
    return FAILED if any(one.verdict is Verdict.FALLS for one in found) else OK


def _print(found: list[Forecast], assumptions: Sequence[str]) -> None:
    """Print a table of all forecasts, then the falls, the collisions, and all that was assumed."""
    if not found:
        print_text("there is no macro to check; --all checks actions")
        return
    columns = ("", "", "verdict", "lean", "margin", "torque", "lag")
    rows = [(*_named(one), one.verdict, *_measured(one)) for one in found]
    print_table(Table(columns, rows))
    for one in found:
        if (fall := one.fall) is not None:
            print_text(f"{name_of(one.record)} {one.verdict}: {_fall(fall)}", "red")
    for one in found:
        for collision in one.collisions:
            print_text(f"{name_of(one.record)}: {' and '.join(collision.parts)} touch at {collision.seconds:.1f} s")
        if not one.is_whole:
            print_text(f"{name_of(one.record)} takes {one.seconds:.0f} s; only the beginning was tried")
    if assumptions:
        print_text(f"assumed, as the figure does not say: {'; '.join(assumptions)}")


def _named(one: Forecast) -> tuple[str, str]:
    """Return type and id of the record, and its caption."""
    kind = type_of(one.record)
    return f"{kind.label} {kind.id_of(one.record)}", kind.caption_of(one.record)


def _measured(one: Forecast) -> tuple[str, str, str, str]:
    """Return lean, margin, torque and lag as texts; of several servos, the worst."""
    margin = "" if one.margin_mm is None else f"{one.margin_mm:.0f} mm"
    torque, lag = (max(values.items(), key=itemgetter(1), default=None) for values in (one.torque, one.lag))
    return (
        f"{one.worst_tilt:.0f}°",
        margin,
        "" if torque is None else f"{torque[1]:.0%} of servo {torque[0]}",
        "" if lag is None else f"{lag[1]:.0f}° of servo {lag[0]}",
    )


def _fall(fall: Fall) -> str:
    """Return time, step and body of a fall as a text."""
    factors = [f"{factor:.0%} of its {name}" for name, factor in asdict(fall.variation).items() if factor != 1]
    return f"at {fall.seconds:.1f} s, {fall.step}" + (f" (with {', '.join(factors)})" if factors else "")


def _write_picture(args: argparse.Namespace, project: Project, body: Body, found: list[Forecast]) -> None:
    """Draw the first of the falls, or else of the doubtful ones, or else the largest lean."""
    from servolink.twin.picture import draw

    one = max(found, key=lambda one: (one.verdict == "falls", one.fall is not None, one.worst_tilt))
    _write_new(args, args.picture, draw(project, body, one.record, *one.moment))
    if not args.json:
        print_text(f"{args.picture}: written, {name_of(one.record)} at {one.moment[1]:.1f} s")


def _write_new(args: argparse.Namespace, path: Path, content: bytes) -> None:
    """Write a file. Raise ProjectError for an existing one without `--force`."""
    if path.exists() and not args.force:
        raise ProjectError(f"{path}: exists already; --force replaces it")
    try:
        write_atomically(path, content)
    except OSError as error:
        raise ProjectError(f"{path}: cannot be written: {reason(error)}") from error


@Command(
    "twin soften",
    help="slow down the macros in which the robot falls, or make their movements smaller",
    details=(
        "For each macro that does not stand, as `twin check` says, the least slowing is looked for, and where none "
        "helps the largest angles. Without -o and --in-place nothing is written. `servolink plan` shows what the "
        "result would change on a board."
    ),
    examples=("twin soften robot.servolink.json -o soft.servolink.json",),
    options=(
        FILE,
        option("--macro", "NAME", "soften this macro only: caption or id"),
        one_of(
            option("-o --output", "OUT", "write the result to this file", new_file),
            flag("--in-place", "write the result to FILE itself"),
        ),
        *FORCE,
    ),
    takes_board=False,
)
def run_soften(args: argparse.Namespace) -> int:
    """Print and write the changes; return 1 if no change helps a macro, else 0."""
    from servolink.twin.body import read_body
    from servolink.twin.soften import AMPLITUDES, SPEEDS, soften

    project, body = read_body(args.source)
    by_type(project)  # refuses duplicate ids: the board would run either record
    macros = project.macros if args.macro is None else [find(project, args.macro, (MACRO,))]
    found = soften(project, body, macros)
    unsolved = [macro.macro_id for macro in found.unsolved]
    if args.output is not None or args.in_place:
        write_edited(args, project, found.project, list(found.changes), unsolved=unsolved)
    elif args.json:
        print_json({"file": None, "written": False, "changes": found.changes, "unsolved": unsolved})
    else:
        for change in found.changes or ("the robot stands in all macros: nothing to change",)[: not unsolved]:
            print_text(change)
        if found.changes:
            print_text("nothing was written; -o OUT or --in-place does")
    if not args.json:
        for macro in found.unsolved:
            tried = f"no speed down to {SPEEDS[-1]} % and no angles down to {AMPLITUDES[-1]} %"
            print_text(f"{name_of(macro)}: {tried} let the robot stand; change the poses", "red")
    return FAILED if unsolved else OK


@Command(
    "twin model",
    help="write the body as a model for MuJoCo",
    details="MuJoCo's own viewer shows it: python -m mujoco.viewer --mjcf=robot.xml",
    examples=("twin model robot.servolink.json -o robot.xml",),
    options=(
        FILE,
        option("-o --output", "OUT", "write the model to this file, and not to standard output", new_file),
        *FORCE,
    ),
    takes_board=False,
)
def run_model(args: argparse.Namespace) -> int:
    """Write the model; where MuJoCo is installed, only a model that MuJoCo can build."""
    from servolink.twin.body import read_body
    from servolink.twin.mjcf import model_text
    from servolink.twin.simulation import Physics, is_installed

    _, body = read_body(args.source)
    if is_installed():
        Physics(body)
    text = model_text(body)
    if args.output is None:
        if args.json:
            print_json({"model": text})
        else:
            print(text, end="")
        return OK
    _write_new(args, args.output, text.encode())
    found = {"file": str(args.output), "parts": len(body.parts), "servos": sorted(body.drives), "mass": body.mass}
    size = f"{counted(len(body.parts), 'part')}, {counted(len(body.drives), 'servo')}, {body.mass:.3g} kg"
    print_result(args, found, f"{args.output}: written, with {size}")
    return OK
