"""Change what a board stores for servos: their captions and their angle corrections."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping

from msgspec.structs import replace

from servolink.cli.session import Interruption
from servolink.cli.stored.change import change_content
from servolink.client.board import Board
from servolink.project.build import refuse_new_errors
from servolink.project.model import Project
from servolink.project.records import by_servo
from servolink.protocol.records import ServoParameter


async def change_parameters(
    args: argparse.Namespace,
    board: Board,
    interruption: Interruption,
    changes: Mapping[int, Callable[[ServoParameter], ServoParameter]],
) -> int:
    """Store what `changes`, by servo id, make of what is stored, after a backup, and read it back.

    Return the exit code.
    """

    def edit(project: Project, encoding: str) -> Project:
        stored = by_servo(project)
        for servo_id, change in changes.items():
            stored[servo_id] = change(stored.get(servo_id, ServoParameter(servo_id)))
        after = replace(project, servo_parameters=tuple(stored.values()))
        refuse_new_errors(project, after, encoding)
        return after

    return await change_content(args, board, interruption, edit)
