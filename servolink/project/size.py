"""What a project takes of a board's memory."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain

from servolink.project.kinds import KINDS, Record
from servolink.project.model import Project, telling
from servolink.protocol.editing import AddServoParameterRequest, ServoParameter
from servolink.protocol.layout import layout
from servolink.protocol.packet import Packet


def stored_size(record: Record | ServoParameter) -> int:
    """Return the bytes that `record` has on the wire, which is what a board is taken to store: 38 + 5n for an action.

    Boards may keep a little more or less for it; none says.
    """
    if isinstance(record, ServoParameter):
        return layout(AddServoParameterRequest, "little").rule.unit
    adding: type[Packet] = next(kind.adding for kind in KINDS if isinstance(record, kind.record))
    rule = layout(adding, "little").rule
    return rule.base + rule.unit * len(getattr(record, record.__struct_fields__[-1]))


def total_size(project: Project) -> int:
    """Return the bytes of everything in `project` that is stored, ids and the choice of a table left out."""
    records: Iterable[Record | ServoParameter] = chain(
        telling(project.servo_parameters), project.actions, project.macros, project.joystick_tables
    )
    return sum(stored_size(record) for record in records)
