"""What goes over the line for a project."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import Struct

from servolink.project.imports.writes import Write
from servolink.project.kinds import KINDS
from servolink.project.model import Project
from servolink.project.size import stored_size
from servolink.protocol.codec import Codec
from servolink.protocol.frame import OVERHEAD

_COUNT = 2
_ID = 4
_ENTRY = 36  # a record in a list
_RESULT = OVERHEAD + 1
_ID_QUERY, _ID_WRITE = 2 * OVERHEAD + _ID, OVERHEAD + _ID + _RESULT
_OUTLINE = 6  # requests: project id, servo parameters, active table, three lists


class Cost(Struct, frozen=True):
    """Requests with their answers, on a line without damage."""

    requests: int = 0
    wire_bytes: int = 0
    """In both directions."""

    def __add__(self, other: Cost) -> Cost:
        """Return both together."""
        return Cost(self.requests + other.requests, self.wire_bytes + other.wire_bytes)


def cost_of_writing(todo: Iterable[Write], codec: Codec) -> Cost:
    """Return what these requests cost."""
    sizes = [len(codec.encode(write.request, exact=True)) + _RESULT for write in todo]
    return Cost(len(sizes), sum(sizes))


def cost_of_marking(times: int) -> Cost:
    """Return what it costs to write the project id so often, and to read it back each time."""
    return Cost(3 * times, times * (_ID_WRITE + 2 * _ID_QUERY))


def cost_of_reading(project: Project) -> Cost:
    """Return what it costs to read all of it until two readings agree, which on a good line is twice."""
    records = [record for kind in KINDS for record in kind.of(project).values()]
    numbers = 2 * _ID
    lists = len(KINDS) * _COUNT + _ENTRY * len(records)
    parameters = _COUNT + sum(map(stored_size, project.servo_parameters))
    outline = 2 * _OUTLINE * OVERHEAD + numbers + lists + parameters
    each = sum(2 * OVERHEAD + _ID + stored_size(record) for record in records)
    # The outline is read twice before the records and once after them.
    return Cost(3 * _OUTLINE + 2 * len(records), 3 * outline + 2 * each)
