"""Project: everything stored on a board (4.2, 4.3)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from servolink.protocol.packet import I32
from servolink.protocol.records import Action, JoystickTable, Macro, ServoParameter

UNFINISHED = range(0x7A00_0000, 0x7A10_0000)
"""Project ids with the meaning "an import is under way". The number identifies the journal (`transfer.backups`)."""


def is_unfinished(project_id: int) -> bool:
    """Return whether a project id marks an import under way."""
    return project_id in UNFINISHED


class Project(Struct, frozen=True, forbid_unknown_fields=True):
    """Everything stored on a board, in the types of the packets."""

    project_id: Annotated[I32, Meta(description="0 for none")] = 0
    servo_parameters: tuple[ServoParameter, ...] = ()
    actions: tuple[Action, ...] = ()
    macros: tuple[Macro, ...] = ()
    joystick_tables: tuple[JoystickTable, ...] = ()
    active_joystick_table: Annotated[I32 | None, Meta(description="null: the board chooses")] = None

    def __repr__(self) -> str:
        """Return the project with the number of records in place of all records."""
        from servolink.project.summary import repr_with_counts

        return repr_with_counts(self)

    def _repr_html_(self) -> str:
        """Return a table of the records for notebooks."""
        from servolink.project.summary import project_table

        return project_table(self)

    def sorted(self) -> Project:
        """Return the project with records in order of ids, without parameters equal to a servo's defaults."""
        return msgspec.structs.replace(
            self,
            servo_parameters=tuple(sorted(without_neutral(self.servo_parameters), key=lambda one: one.servo_id)),
            actions=tuple(sorted(self.actions, key=lambda one: one.action_id)),
            macros=tuple(sorted(self.macros, key=lambda one: one.macro_id)),
            joystick_tables=tuple(sorted(self.joystick_tables, key=lambda one: one.table_id)),
        )


def without_neutral(parameters: Iterable[ServoParameter]) -> list[ServoParameter]:
    """Return the parameters with a caption or a correction.

    The protocol cannot delete parameters, only write neutral values, so neutral and missing parameters are equal.
    """
    return [one for one in parameters if one.adjusted_degree or one.servo_caption]
