"""Repair of project problems with a single right solution."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from operator import itemgetter
from typing import Any

from msgspec.structs import replace

from servolink.project.model import Project, name_of
from servolink.project.record_lookup import wrong_durations
from servolink.project.validate import duplicates, number_of
from servolink.protocol import ACTION, STORED_TYPES, TABLE, ServoParameter


def fix_project(project: Project) -> tuple[Project, list[str]]:
    """Return `project` without the fixable problems of `validate_project`, and the list of repairs.

    Problems with several solutions, such as references to missing records, stay for the author.
    """
    repairs: list[str] = []
    for kind in STORED_TYPES:
        records = _in_order(kind.field, _without_duplicates(getattr(project, kind.field), _name, repairs), repairs)
        project = replace(project, **{kind.field: records})
    for kind, word in ((ACTION, "servo"), (TABLE, "button")):
        records = tuple(_with_unique_parts(one, word, repairs) for one in getattr(project, kind.field))
        # Two records that differed only in duplicate parts may be identical now.
        project = replace(project, **{kind.field: _without_duplicates(records, _name, repairs)})
    return _with_durations(_with_active_table(project, repairs), repairs), repairs


def _name(record: Any) -> str:
    return f"servo {record.servo_id}" if isinstance(record, ServoParameter) else name_of(record)


def _without_duplicates(parts: Sequence[Any], name: Callable[[Any], str], repairs: list[str]) -> tuple[Any, ...]:
    needless = {one.at for one in duplicates(parts) if one.same}
    repairs += [f"{name(parts[at])}: removed a copy with the same values" for at in sorted(needless)]
    return tuple(part for at, part in enumerate(parts) if at not in needless)


def _with_unique_parts(record: Any, word: str, repairs: list[str]) -> Any:
    """Remove duplicate steps or buttons, the last field of `record`."""
    name = record.__struct_fields__[-1]
    parts = _without_duplicates(
        getattr(record, name), lambda part: f"{name_of(record)}, {word} {number_of(part)}", repairs
    )
    return replace(record, **{name: parts})


def _in_order(field: str, records: tuple[Any, ...], repairs: list[str]) -> tuple[Any, ...]:
    found = tuple(sorted(records, key=number_of))
    if found != records:
        repairs.append(f"{field}: sorted by id")
    return found


def _with_active_table(project: Project, repairs: list[str]) -> Project:
    ids = TABLE.by_id(project)
    active = project.active_joystick_table
    if active is None or active in ids or len(ids) > 1:
        return project
    instead = next(iter(ids), None)
    what = "null, because there is no table" if instead is None else f"{instead}, the only table"
    repairs.append(f"active_joystick_table: was {active}, which does not exist; is now {what}")
    return replace(project, active_joystick_table=instead)


def _with_durations(project: Project, repairs: list[str]) -> Project:
    macros = list(project.macros)
    for at, wrong in groupby(wrong_durations(project), key=itemgetter(0)):
        commands = list(macros[at].commands)
        for _, number, takes in wrong:
            stated = commands[number].total_interval
            repairs.append(
                f"{name_of(macros[at])}, command {number + 1}: total_interval_ms was {stated}, is now {takes}"
            )
            commands[number] = replace(commands[number], total_interval=takes)
        macros[at] = replace(macros[at], commands=tuple(commands))
    return replace(project, macros=tuple(macros))
