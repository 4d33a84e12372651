"""`servolink project`: show, check, edit and play projects without a board."""

from __future__ import annotations

from servolink.cli.commands import Command
from servolink.cli.parser import Parser


def _command(place: str, text: str, *examples: str) -> Command:
    return Command("", f"projects.{place}", text, tuple(f"project {one}" for one in examples), takes_board=False)


COMMANDS = {
    "show": _command(
        "show:configure",
        "show what a project contains",
        "show robot.servolink.json",
        "show robot.servolink.json Bow",
    ),
    "new": _command("edit:configure_new", "write a small project to start with", "new arm.servolink.json --servos 6"),
    "check": _command(
        "check:configure_check",
        "find what is wrong with a project, and repair it",
        "check robot.servolink.json",
        "check robot.servolink.json --fix",
    ),
    "preflight": _command(
        "check:configure_preflight",
        "find movements that are too fast or go too far",
        "preflight robot.servolink.json --speed-cap 120",
    ),
    "play": _command(
        "play:configure",
        "play an action or a macro: as a chart of its movements, or on a robot without storing it there",
        "play robot.servolink.json Bow --fast",
        "play robot.servolink.json Bow --board virtual://?servos=20",
    ),
    "mirror": _command(
        "edit:configure_mirror",
        "add actions and macros with left and right exchanged",
        "mirror robot.servolink.json Bow --map 1=2 -o both.json",
    ),
    "scale-time": _command(
        "edit:configure_scale_time",
        "make actions, or everything, slower or faster",
        "scale-time robot.servolink.json 2 -o slow.servolink.json",
        "scale-time robot.servolink.json 0.5 Bow --in-place",
    ),
    "merge": _command(
        "edit:configure_merge",
        "merge two projects into one",
        "merge robot.servolink.json other.json -o all.json",
    ),
    "rename": _command(
        "edit:configure_rename",
        "give an action, a macro, a table or a servo another caption",
        "rename robot.servolink.json action 1 Hello --in-place",
    ),
    "schema": _command("edit:configure_schema", "print the JSON Schema of project files", "schema"),
}
"""As `servolink.cli.commands.COMMANDS`."""


def configure(parser: Parser) -> None:
    """Add the commands of `servolink project`."""
    parser.add_commands(COMMANDS, "project_command")
