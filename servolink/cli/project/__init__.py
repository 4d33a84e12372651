"""`servolink project`: projects in files, edited, checked and played without a board."""

from __future__ import annotations

import argparse
from typing import Any

from servolink.cli.main import EXIT_CODES, command_function, common_options

COMMANDS = {
    "show": ("servolink.cli.project.show", "show what is in a project, or some of it whole"),
    "new": ("servolink.cli.project.edit:new", "write a small project to begin with"),
    "check": ("servolink.cli.project.check:check", "find what is wrong with a project, and repair it"),
    "preflight": ("servolink.cli.project.check:preflight", "find movements that are too fast or go too far"),
    "play": ("servolink.cli.project.play", "play an action or a macro on a virtual board, with a chart of its times"),
    "mirror": ("servolink.cli.project.edit:mirror", "add actions and macros with left and right exchanged"),
    "scale-time": ("servolink.cli.project.edit:edits", "make actions, or everything, slower or faster"),
    "merge": ("servolink.cli.project.edit:edits", "put two projects into one"),
    "rename": ("servolink.cli.project.edit:edits", "give an action, a macro, a table or a servo another caption"),
    "schema": ("servolink.cli.project.edit:schema", "print the JSON Schema of project files"),
}
"""As `servolink.cli.main.COMMANDS`."""


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the commands of `servolink project`."""
    commands = parser.add_subparsers(dest="project_command", required=True, metavar="COMMAND")
    for name, (module, text) in COMMANDS.items():
        added: Any = commands.add_parser(
            name,
            help=text,
            description=text[:1].upper() + text[1:] + ".",
            epilog=EXIT_CODES,
            parents=[common_options(given=True)],
        )
        added.module = module
        added.set_defaults(parser=added)


def run(args: argparse.Namespace) -> int:
    """Run the command that was given."""
    return int(command_function(COMMANDS[args.project_command][0], "run")(args))
