"""What differs between two projects."""

from __future__ import annotations

from typing import Any

from servolink.project.imports.results import Change
from servolink.project.kinds import KINDS, TABLE
from servolink.project.model import Project


def compare(old: Project, new: Project) -> tuple[Change, ...]:
    """Return what turns `old` into `new`, in the order of a project file."""
    old, new = old.sorted(), new.sorted()
    changes = _values("project id", old.project_id or None, new.project_id or None)
    changes += _records("servo parameter", _by_servo(old), _by_servo(new))
    for kind in KINDS:
        changes += _records(kind.word, kind.of(old), kind.of(new))
    if new.active_joystick_table in TABLE.of(new):
        changes += _values("active joystick table", old.active_joystick_table, new.active_joystick_table)
    return tuple(changes)


def _values(what: str, old: Any, new: Any) -> list[Change]:
    return [] if old == new else [Change(what, old, new)]


def _records(word: str, old: dict[int, Any], new: dict[int, Any]) -> list[Change]:
    return [
        Change(f"{word} {record_id}", old.get(record_id), new.get(record_id))
        for record_id in sorted(old.keys() | new.keys())
        if old.get(record_id) != new.get(record_id)
    ]


def _by_servo(project: Project) -> dict[int, Any]:
    return {one.servo_id: one for one in project.servo_parameters}
