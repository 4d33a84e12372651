"""Why the board does not hold what was written to it, in words."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from servolink.escaping import quote
from servolink.project.transfer.content import Content
from servolink.project.transfer.writes import Write
from servolink.protocol.editing import AddServoParameterRequest
from servolink.protocol.record_types import RecordType

_MOST = 3


def explain_failed_writes(content: Content, todo: Sequence[Write], refused: Collection[str]) -> str:
    """Return which writes of `todo` are still to be done with `content` on the board, the first ones with a reason.

    `refused` are the items to which the board said no.
    """
    found = {write.item: _reason(content, write, refused) for write in todo}
    words = [f"{item} ({reason})" if reason else item for item, reason in found.items()]
    text = ", ".join(words[:_MOST]) + (f" and {len(words) - _MOST} more" if len(words) > _MOST else "")
    is_full = any(write.item in refused and write.record is not None for write in todo)
    return f"{text}, perhaps because its memory is full" if is_full else text


def _reason(content: Content, write: Write, refused: Collection[str]) -> str:
    request: Any = write.request
    if write.item in refused:
        if isinstance(request, AddServoParameterRequest):
            return "refused; has it all these servos?"
        return "refused"
    if isinstance(request, AddServoParameterRequest):
        servo_ids = [one.servo_id for one in request.servos if one not in content.servo_parameters]
        return f"servo {servo_ids[0]} comes back otherwise" if servo_ids else ""
    if write.record_type is None:
        return ""
    return "still listed" if write.record is None else _difference(content, write.record_type, write)


def _difference(content: Content, record_type: RecordType[Any], write: Write) -> str:
    """Return how the record that the board returns differs from the one that it was given."""
    entries = [entry for entry in content.records[record_type] if entry.record_id == write.record_id]
    if not entries:
        return "not there afterwards"
    found = entries[0].record
    if found is None:
        return "listed and not returned"
    if len(entries) > 1:
        return f"listed {len(entries)} times"
    if (caption := record_type.caption_of(found)) != record_type.caption_of(write.record):
        return f"its caption comes back as {quote(caption)}"
    return f"other {record_type.record_class.__struct_fields__[-1]} come back"
