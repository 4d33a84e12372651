"""`servolink twin`: the body of a project's figure, with physics."""

from __future__ import annotations

import argparse

from servolink.cli.arguments import file_path, new_file
from servolink.cli.command import PROJECTS, Command, option
from servolink.cli.projects.source import FORCE
from servolink.cli.screen.output import counted, print_json, print_result
from servolink.errors import ProjectError
from servolink.script import OK

FILE = option("source", "FILE", "a project file with a figure", file_path)

TWIN = Command(
    "twin",
    PROJECTS,
    help="give the robot of a project a body with physics",
    details="The body follows from the figure of the project; masses and servos can be written there.",
    examples=("twin model robot.servolink.json -o robot.xml",),
    takes_board=False,
)


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
    from servolink.files import reason, write_atomically
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
    if args.output.exists() and not args.force:
        raise ProjectError(f"{args.output}: exists already; --force replaces it")
    try:
        write_atomically(args.output, text.encode())
    except OSError as error:
        raise ProjectError(f"{args.output}: cannot be written: {reason(error)}") from error
    found = {"file": str(args.output), "parts": len(body.parts), "servos": sorted(body.drives), "mass": body.mass}
    size = f"{counted(len(body.parts), 'part')}, {counted(len(body.drives), 'servo')}, {body.mass:.3g} kg"
    print_result(args, found, f"{args.output}: written, with {size}")
    return OK
