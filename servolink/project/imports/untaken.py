"""Why what was written to a board is not there, in words."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from servolink.printable import shown
from servolink.project.imports.read import Content
from servolink.project.imports.writes import Write
from servolink.project.kinds import KINDS, Kind
from servolink.protocol.editing import AddServoParameterRequest

_MOST = 3


def untaken(content: Content, todo: Sequence[Write], refused: Collection[str]) -> str:
    """Return what of `todo` is still to be done with `content` on the board, the first of it with a reason each.

    `refused` are the items to which the board said no.
    """
    found = {write.item: _reason(content, write, refused) for write in todo}
    words = [f"{item} ({reason})" if reason else item for item, reason in found.items()]
    return ", ".join(words[:_MOST]) + (f" and {len(words) - _MOST} more" if len(words) > _MOST else "")


def _reason(content: Content, write: Write, refused: Collection[str]) -> str:
    request: Any = write.request
    if write.item in refused:
        return "refused; has it all these servos?" if isinstance(request, AddServoParameterRequest) else "refused"
    if isinstance(request, AddServoParameterRequest):
        servo_ids = [one.servo_id for one in request.servos if one not in content.servo_parameters]
        return f"servo {servo_ids[0]} comes back otherwise" if servo_ids else ""
    for kind in KINDS:
        if isinstance(request, kind.deleting):
            return "still listed"
        if isinstance(request, kind.adding):
            return _difference(content, kind, request)
    return ""


def _difference(content: Content, kind: Kind, request: Any) -> str:
    """Return what is another in the record that the board gives than in the one that it was given."""
    record_id = kind.id_of(request)
    entries = [entry for entry in content.records[kind] if entry.record_id == record_id]
    if not entries:
        return "not there afterwards"
    given = entries[0].record
    if given is None:
        return "listed and not given"
    if len(entries) > 1:
        return f"listed {len(entries)} times"
    if (caption := kind.caption_of(given)) != kind.caption_of(request):
        return f"its caption comes back as {shown(caption)}"
    return f"other {kind.record.__struct_fields__[-1]} come back"
