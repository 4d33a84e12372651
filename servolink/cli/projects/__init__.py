"""Commands about projects: what is stored on a board, as a file."""

from __future__ import annotations

from servolink.cli.command import PROJECTS, Command

PROJECT = Command(
    "project",
    PROJECTS,
    help="show, check, edit and play projects in files, without a board",
    examples=("project new arm.servolink.json --servos 6", "project show robot.servolink.json"),
    takes_board=False,
)
