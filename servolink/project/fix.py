"""Repairs of what has one right answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from operator import itemgetter
from typing import Any

from msgspec.structs import replace

from servolink.project.model import Project
from servolink.project.records import named, wrong_times
from servolink.project.validate import number_of, repeats
from servolink.protocol.record_types import RECORD_TYPES
from servolink.protocol.records import ServoParameter


def fix_project(project: Project) -> tuple[Project, list[str]]:
    """Return `project` with what `validate_project` calls fixable repaired, and the list of repairs.

    Nothing is done where only its author can know, such as about a call of what is not there.
    """
    done: list[str] = []
    for place in ("servo_parameters", *(kind.field for kind in RECORD_TYPES)):
        records = _in_order(place, _once(getattr(project, place), _name, done), done)
        project = replace(project, **{place: records})
    for place, word in (("actions", "servo"), ("joystick_tables", "button")):
        records = tuple(_with_parts_once(one, word, done) for one in getattr(project, place))
        project = replace(project, **{place: _once(records, _name, done)})  # two may now be the same
    return _with_times(_with_active_table(project, done), done), done


def _name(record: Any) -> str:
    return f"servo {record.servo_id}" if isinstance(record, ServoParameter) else named(record)


def _once(parts: Sequence[Any], name: Callable[[Any], str], done: list[str]) -> tuple[Any, ...]:
    """Leave out what is there twice with the same values."""
    needless = {repeat.at for repeat in repeats(parts) if repeat.same}
    done += [f"{name(parts[at])}: left out, it is there twice with the same values" for at in sorted(needless)]
    return tuple(part for at, part in enumerate(parts) if at not in needless)


def _with_parts_once(record: Any, word: str, done: list[str]) -> Any:
    """Leave out steps or buttons, the last field of `record`, that are there twice with the same values."""
    name = record.__struct_fields__[-1]
    parts = _once(getattr(record, name), lambda part: f"{named(record)}, {word} {number_of(part)}", done)
    return replace(record, **{name: parts})


def _in_order(place: str, records: tuple[Any, ...], done: list[str]) -> tuple[Any, ...]:
    found = tuple(sorted(records, key=number_of))
    if found != records:
        done.append(f"{place}: put in order of their ids")
    return found


def _with_active_table(project: Project, done: list[str]) -> Project:
    tables = {table.table_id for table in project.joystick_tables}
    active = project.active_joystick_table
    if active in (None, *tables) or len(tables) > 1:
        return project
    instead = next(iter(tables), None)
    what = "none, as there is no table" if instead is None else f"{instead}, the only table"
    done.append(f"active_joystick_table: {active} is not there; it is now {what}")
    return replace(project, active_joystick_table=instead)


def _with_times(project: Project, done: list[str]) -> Project:
    macros = list(project.macros)
    for at, wrong in groupby(wrong_times(project), key=itemgetter(0)):
        commands = list(macros[at].commands)
        for _, number, takes in wrong:
            given = commands[number].total_interval
            done.append(f"{named(macros[at])}, command {number + 1}: total_interval_ms is now {takes}, it was {given}")
            commands[number] = replace(commands[number], total_interval=takes)
        macros[at] = replace(macros[at], commands=tuple(commands))
    return replace(project, macros=tuple(macros))
