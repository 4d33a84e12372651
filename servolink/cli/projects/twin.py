"""`servolink twin`: the body of a project's figure, with physics."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from operator import itemgetter
from typing import Any

from msgspec import UNSET, UnsetType
from msgspec.structs import asdict

from servolink.cli.arguments import new_file, not_empty
from servolink.cli.command import PROJECTS, Command, flag, one_of, option
from servolink.cli.projects.source import FORCE, ProjectEdited, write_bytes, write_edited
from servolink.cli.screen.output import Table, counted
from servolink.cli.screen.result import CommandResult, Part, Returned, Verbatim, print_for_people, show
from servolink.project import Project, name_of
from servolink.protocol import ACTION, MACRO, RecordType
from servolink.support import ExitCode
from servolink.twin import Body, Fall, Forecast, checked_model, forecast, soften

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
    project, body = Body.read(args.source)
    project.by_type()  # refuses duplicate ids: the board would run either record
    if args.macro is not None:
        records = [project.find(args.macro, (MACRO, ACTION))]
    else:
        records = [*(project.actions if args.all else ()), *project.macros]
    found = forecast(project, body, records, processes=os.cpu_count() or 1)
    ok = all(one.verdict != "falls" for one in found)
    value = TwinChecked(ok, body.basis, body.assumptions, [one.as_dict() for one in found])
    show(value, _text(found, body))
    if args.picture is not None and found:
        _write_picture(args, project, body, found)
    return ExitCode.OK if ok else ExitCode.FAILED


class TwinChecked(CommandResult, frozen=True):
    """JSON of `twin check`: a forecast for each record.

    `basis` is the origin of `weight`, `strength`, `speed` and `lag`: `measured`, `written` in the figure, or `assumed`.
    """

    ok: bool
    basis: dict[str, str]
    assumptions: Sequence[str]
    forecasts: list[dict[str, Any]]


def _text(found: list[Forecast], body: Body) -> Iterator[Part]:
    """Yield a table of all forecasts, then the falls, the collisions, and all that was assumed."""
    if not found:
        yield "there is no macro to check; --all checks actions"
        return
    columns = ("", "", "verdict", "lean", "margin", "torque", "lag")
    yield Table(columns, [(*_named(one), one.verdict, *_measured(one)) for one in found])
    for one in found:
        if (fall := one.fall) is not None:
            yield f"{name_of(one.record)} {one.verdict}: {_fall(fall)}", "red"
    for one in found:
        for collision in one.collisions:
            yield f"{name_of(one.record)}: {' and '.join(collision.parts)} touch at {collision.seconds:.1f} s"
        if not one.is_whole:
            yield f"{name_of(one.record)} takes {one.seconds:.0f} s; only the beginning was tried"
    yield f"this rests on: {', '.join(f'{name} {origin}' for name, origin in body.basis.items())}"
    if body.assumptions:
        yield f"assumed, as the figure does not say: {'; '.join(body.assumptions)}"


def _named(one: Forecast) -> tuple[str, str]:
    """Return type and id of the record, and its caption."""
    kind = RecordType.of(one.record)
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
    one = max(found, key=lambda one: (one.verdict == "falls", one.fall is not None, one.worst_tilt))
    write_bytes(args, args.picture, one.picture(project, body))
    print_for_people(f"{args.picture}: written, {name_of(one.record)} at {one.moment[1]:.1f} s")


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
def run_soften(args: argparse.Namespace) -> Returned:
    """Print and write the changes; return 1 if no change helps a macro, else 0."""
    project, body = Body.read(args.source)
    project.by_type()  # refuses duplicate ids: the board would run either record
    macros = project.macros if args.macro is None else [project.find(args.macro, (MACRO,))]
    found = soften(project, body, macros)
    unsolved = [macro.macro_id for macro in found.unsolved]
    if args.output is not None or args.in_place:
        value, text, _ = write_edited(args, project, found.project, found.changes, unsolved=unsolved)
    else:
        value = ProjectEdited(file=None, written=False, changes=found.changes, unsolved=unsolved)
        text = [*found.changes, "nothing was written; -o OUT or --in-place does"]
        if not found.changes:
            text = [] if unsolved else "the robot stands in all macros: nothing to change"
    left = f"{found.tried} let the robot stand; change the poses"
    unstable = [(f"{name_of(macro)}: {left}", "red") for macro in found.unsolved]
    return Returned(value, [text, *unstable], ExitCode.FAILED if unsolved else ExitCode.OK)


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
def run_model(args: argparse.Namespace) -> Returned:
    """Write the model; where MuJoCo is installed, only a model that MuJoCo can build."""
    _, body = Body.read(args.source)
    text = checked_model(body)
    if args.output is None:
        return Returned(TwinModel(model=text), Verbatim(text))
    write_bytes(args, args.output, text.encode())
    servos = sorted(body.drives)
    size = f"{counted(len(body.parts), 'part')}, {counted(len(servos), 'servo')}, {body.mass:.3g} kg"
    value = TwinModel(file=str(args.output), parts=len(body.parts), servos=servos, mass=body.mass)
    return Returned(value, f"{args.output}: written, with {size}")


class TwinModel(CommandResult, frozen=True, kw_only=True):
    """JSON of `twin model`: the model, or the file with the model and its mass in kilograms."""

    model: str | UnsetType = UNSET
    file: str | UnsetType = UNSET
    parts: int | UnsetType = UNSET
    servos: list[int] | UnsetType = UNSET
    mass: float | UnsetType = UNSET
