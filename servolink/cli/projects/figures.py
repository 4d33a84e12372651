"""`servolink figure`: the figure of a project in the format of ROS."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from msgspec import UNSET

from servolink.cli.arguments import file_path, new_file
from servolink.cli.command import PROJECTS, Command, one_of, option
from servolink.cli.projects.source import FORCE, write_bytes, write_new
from servolink.cli.projects.twin import FILE
from servolink.cli.screen.output import counted
from servolink.cli.screen.result import CommandResult, Returned
from servolink.errors import ProjectError
from servolink.project import Figure, Project, ProjectFile
from servolink.protocol import ServoParameter
from servolink.twin import read_urdf, to_urdf

FIGURE = Command(
    "figure",
    PROJECTS,
    help="exchange the figure of a project with ROS and other programs",
    details="The figure is the shape of the robot, with the joints turned by servos. No board takes part.",
    examples=("figure export robot.servolink.json robot.urdf", "figure import robot.urdf"),
    takes_board=False,
)


class FigureExchanged(CommandResult, frozen=True):
    """JSON of `figure export` and `figure import`: the file that was written, with so many parts and servos.

    `warnings` say what an imported figure does not have of the URDF.
    """

    file: str | None
    parts: int
    servos: int
    warnings: Sequence[str] = ()


@Command(
    "figure export",
    help="write the figure of a project as URDF",
    details="Joints are named by the captions of their servos, with underscores for what ROS does not allow.",
    examples=("figure export robot.servolink.json robot.urdf",),
    options=(FILE, option("output", "URDF", "the file to write", new_file), *FORCE),
    takes_board=False,
)
def run_export(args: argparse.Namespace) -> Returned:
    """Write the URDF."""
    project, _, figure, _ = ProjectFile.read(args.source, unchecked=True)
    if figure is None:
        raise ProjectError(f"{args.source}: has no figure; `servolink studio` fits one to the robot")
    captions = {one.servo_id: one.servo_caption for one in project.servo_parameters}
    write_bytes(args, args.output, to_urdf(figure, captions).encode())
    value = _exchanged(str(args.output), figure)
    return Returned(value, f"{args.output}: written, with {_counts(value)}")


@Command(
    "figure import",
    help="make a figure of a URDF file",
    details=(
        "Meshes become boxes and discs by their bounds. What a figure cannot have is named. Without -o and --into "
        "nothing is written."
    ),
    examples=("figure import robot.urdf", "figure import robot.urdf -o new.servolink.json"),
    options=(
        option("source", "URDF", "the file to read, with its meshes in the same folder or below", file_path),
        one_of(
            option("-o --output", "OUT", "write a new project with the figure", new_file),
            option("--into", "FILE", "put the figure into this project file, which keeps all else", file_path),
        ),
        *FORCE,
    ),
    takes_board=False,
)
def run_import(args: argparse.Namespace) -> Returned:
    """Read the URDF, and write the figure where `args` say."""
    figure, captions, warnings = read_urdf(args.source)
    target = args.output or args.into
    if args.into is not None:
        file = ProjectFile.read(args.into, unchecked=True)
        if file.figure is not None and not args.force:
            raise ProjectError(f"{args.into}: has a figure already; --force replaces it")
        file._replace(figure=figure).write(args.into)
    elif args.output is not None:
        named = tuple(ServoParameter(servo, 0, caption) for servo, caption in captions.items())
        write_new(args, args.output, ProjectFile(Project(servo_parameters=named), figure=figure))
    value = _exchanged(target and str(target), figure, warnings)
    read = f"{args.source}: {_counts(value)}"
    end = f"{target}: written" if target else "nothing was written; -o OUT or --into FILE does"
    return Returned(value, [read, *((one, "yellow") for one in warnings), end])


def _exchanged(file: str | None, figure: Figure, warnings: Sequence[str] = ()) -> FigureExchanged:
    servos = sum(joint.servo is not UNSET for joint in figure.joints)
    return FigureExchanged(file, len(figure.joints), servos, warnings)


def _counts(value: FigureExchanged) -> str:
    return f"{counted(value.parts, 'part')}, {counted(value.servos, 'servo')}"
