"""`servolink help`: as `--help`."""

from __future__ import annotations

import argparse

from servolink.cli.command import FIRST_STEPS, Command, option
from servolink.cli.command_line import parser_of


@Command(
    "help",
    FIRST_STEPS,
    help="explain a command, as --help does",
    examples=("help", "help move", "help project play"),
    options=(option("words", "COMMAND", "name of a command (all commands, by topic)", nargs="*"),),
    takes_board=False,
)
def run(args: argparse.Namespace) -> int:
    """Print the help, and end."""
    parser_of().parse_args([*args.words, "--help"])
    raise AssertionError  # --help ends the program
