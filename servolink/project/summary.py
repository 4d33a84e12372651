"""Contents of records, projects and plans, in a few words or as a table for notebooks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from msgspec import Struct

from servolink.errors import html_table
from servolink.protocol import (
    ACTION,
    MACRO,
    SERVO_PARAMETER,
    STORED_TYPES,
    TABLE,
    Action,
    JoystickTable,
    Macro,
    RecordType,
    ServoParameter,
)

_PART_WORDS = {ACTION: "step", MACRO: "command", TABLE: "button"}


def caption_of(stored: Action | Macro | JoystickTable | ServoParameter) -> str:
    """Return the caption of a record, or the caption stored for a servo."""
    return (SERVO_PARAMETER if isinstance(stored, ServoParameter) else RecordType.of(stored)).caption_of(stored)


def described(stored: Action | Macro | JoystickTable | ServoParameter) -> str:
    """Return caption and content of a record, such as `'Wave': 2 steps, 0.5 s`, or those stored for a servo."""
    return f"'{caption_of(stored)}': {summary_of(stored)}"


def summary_of(stored: Action | Macro | JoystickTable | ServoParameter) -> str:
    """Return the content of a record, such as `2 steps, 0.5 s`, or the correction of a servo."""
    if isinstance(stored, ServoParameter):
        return f"corrected by {stored.adjusted_degree}°"
    kind = RecordType.of(stored)
    count = len(kind.parts_of(stored))
    seconds = f", {stored.seconds:g} s" if isinstance(stored, Action) else ""
    return f"{count} {_PART_WORDS[kind]}{'' if count == 1 else 's'}{seconds}"


def repr_with_counts(value: Struct) -> str:
    """Return the usual `repr` with the number of items in place of each tuple: `Project(..., actions=<3>, ...)`."""
    items = ((name, getattr(value, name)) for name in value.__struct_fields__)
    texts = (f"{name}={f'<{len(item)}>' if isinstance(item, tuple) else repr(item)}" for name, item in items)
    return f"{type(value).__name__}({', '.join(texts)})"


def project_table(project: Any) -> str:
    """Return an HTML table of a `Project`, with a row for each record."""
    rows = (
        (kind, kind.id_of(stored), kind.caption_of(stored), summary_of(stored))
        for kind in STORED_TYPES
        for stored in getattr(project, kind.field)
    )
    return html_table(("record", "id", "caption", "holds"), rows, f"project {project.project_id or 'without id'}")


def plan_table(plan: Any) -> str:
    """Return an HTML table of a `Plan`, with a row for each change."""
    title = f"{len(plan.changes) + len(plan.inconsistencies)} differences, about {max(1, round(plan.seconds))} s"
    return html_table(("record", "on the board", "afterwards"), plan_rows(plan), title)


def plan_rows(plan: Any) -> Iterator[tuple[str, str, str]]:
    """Yield each change of a `Plan`: the name of the record, what the board holds, and what it holds afterwards."""
    for change in plan.changes:
        yield change.what, _state(change.old), _state(change.new)
    for inconsistency in plan.inconsistencies:
        yield inconsistency, "", "corrected"


def _state(value: Any) -> str:
    """Return a side of a change: a record, an id, or nothing."""
    if value is None:
        return "-"
    return str(value) if isinstance(value, int) else described(value)
