"""`servolink project`: projects in files, edited, checked and played without a board."""

from __future__ import annotations

from servolink.cli.commands import Command
from servolink.cli.parser import Parser


def _command(place: str, text: str, *examples: str) -> Command:
    return Command("", f"project.{place}", text, examples, takes_board=False)


COMMANDS = {
    "show": _command("show:configure", "show what is in a project, or some of it whole"),
    "new": _command("edit:configure_new", "write a small project to begin with"),
    "check": _command("check:configure_check", "find what is wrong with a project, and repair it"),
    "preflight": _command("check:configure_preflight", "find movements that are too fast or go too far"),
    "play": _command("play:configure", "play an action or a macro on a virtual board, with a chart of its times"),
    "mirror": _command("edit:configure_mirror", "add actions and macros with left and right exchanged"),
    "scale-time": _command("edit:configure_scale_time", "make actions, or everything, slower or faster"),
    "merge": _command("edit:configure_merge", "put two projects into one"),
    "rename": _command("edit:configure_rename", "give an action, a macro, a table or a servo another caption"),
    "schema": _command("edit:configure_schema", "print the JSON Schema of project files"),
}
"""As `servolink.cli.commands.COMMANDS`; the examples follow `servolink project`."""


def configure(parser: Parser) -> None:
    """Add the commands of `servolink project`."""
    parser.add_commands(COMMANDS, "project_command")
