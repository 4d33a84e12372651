"""Lookup of project records, and computation of sizes and durations."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import suppress
from graphlib import CycleError, TopologicalSorter
from itertools import chain, count
from typing import Any

from msgspec.structs import replace

from servolink.errors import ProjectError
from servolink.escaping import escape
from servolink.project.model import Project, without_neutral
from servolink.project.naming import Named, captioned, closest, id_or_caption, listed
from servolink.protocol.record_types import ACTION, MACRO, RECORD_TYPES, Record, RecordType, stored_size, type_of
from servolink.protocol.records import Action, Macro, MacroCommand, MacroCommandType, ServoParameter

MAX_INTERVAL = 0x7FFF_FFFF
"""Maximum of `total_interval` in milliseconds, nearly 25 days."""


def name_of(record: Any) -> str:
    """Return the name of a record in texts, such as `action 3 'Wave'`, safe to show."""
    kind = type_of(record)
    return f"{kind.label} {kind.id_of(record)} '{escape(kind.caption_of(record))}'"


def by_type(project: Project) -> dict[str, dict[int, Any]]:
    """Return the records of a project by field and id. Raise ProjectError for a duplicate id."""
    for kind in RECORD_TYPES:
        _refuse_duplicates(kind.label, [kind.id_of(record) for record in getattr(project, kind.field)])
    return {kind.field: kind.by_id(project) for kind in RECORD_TYPES}


def by_servo(project: Project) -> dict[int, ServoParameter]:
    """Return the parameters by servo id. Raise ProjectError for a servo with duplicate parameters."""
    _refuse_duplicates("servo parameter", [one.servo_id for one in project.servo_parameters])
    return {one.servo_id: one for one in project.servo_parameters}


def _refuse_duplicates(label: str, ids: list[int]) -> None:
    """Raise ProjectError for a duplicate id: an edit by id would lose one of both objects."""
    if duplicates := [number for number, times in Counter(ids).items() if times > 1]:
        raise ProjectError(f"{label} {duplicates[0]} exists twice; remove a copy, or change an id")


def with_records(project: Project, records: Mapping[str, Mapping[int, Any]]) -> Project:
    """Return `project` with other records, in the form of `by_type`."""
    return replace(project, **{field: tuple(shelf.values()) for field, shelf in records.items()})


def free_id(used_ids: Container[int]) -> int:
    """Return the lowest free id, at least 1, because 0 means "none" everywhere."""
    return next(number for number in count(1) if number not in used_ids)


def with_id(record: Any, record_id: int) -> Any:
    """Return `record` with another id."""
    return replace(record, **{record.__struct_fields__[0]: record_id})


def with_caption(record: Any, caption: str) -> Any:
    """Return `record` with another caption."""
    return replace(record, **{record.__struct_fields__[1]: caption})


def with_dependencies(project: Project, records: Iterable[Record]) -> list[Record]:
    """Return `records` and all records run by them, directly or not, each once, without missing records.

    Raise ProjectError for a duplicate id in `project`.
    """
    shelves = by_type(project)
    waiting, found = list(records), dict[tuple[str, int], Record]()
    while waiting:
        record = waiting.pop()
        kind = type_of(record)
        if (key := (kind.field, kind.id_of(record))) in found:
            continue
        found[key] = record
        waiting += [
            shelves[target.field][number]
            for target, number in kind.references(record)
            if number in shelves[target.field]
        ]
    return list(found.values())


def servos_used(project: Project, record: Record) -> set[int]:
    """Return the ids of the servos moved by `record`, directly or through other records."""
    actions = (one for one in with_dependencies(project, [record]) if isinstance(one, Action))
    return {step.servo_id for action in actions for step in action.steps}


def total_size(project: Project) -> int:
    """Return the bytes of all records and servo parameters of `project` on a board."""
    stored: Iterable[Record | ServoParameter] = chain(
        without_neutral(project.servo_parameters), project.actions, project.macros, project.joystick_tables
    )
    return sum(map(stored_size, stored))


def dependency_levels(macros: Mapping[int, Macro]) -> list[set[int]]:
    """Return the ids of macros in levels: each runs only macros of earlier levels. Endless macros are left out."""
    sorter = TopologicalSorter(
        {
            macro_id: {called for kind, called in MACRO.references(macro) if kind is MACRO and called in macros}
            for macro_id, macro in macros.items()
        }
    )
    with suppress(CycleError):  # the sorter still returns every macro that does not lead into a cycle
        sorter.prepare()
    found: list[set[int]] = []
    while ready := sorter.get_ready():
        found.append(set(ready))
        sorter.done(*ready)
    return found


def dependency_order(macros: Mapping[int, Macro]) -> list[int]:
    """Return the ids of macros, inner macros before outer macros. Endless macros are left out."""
    return [macro_id for level in dependency_levels(macros) for macro_id in sorted(level)]


def durations(project: Project) -> dict[int, tuple[int | None, ...]]:
    """Return the duration of each command with ratio and loops, the `total_interval` in milliseconds, by macro id.

    None stands for an unknown duration, because the command runs a missing or endless record, and for a duration
    above MAX_INTERVAL.
    """
    actions, macros = ACTION.by_id(project), MACRO.by_id(project)
    found: dict[int, tuple[int | None, ...]] = {
        macro_id: (None,) * len(macro.commands) for macro_id, macro in macros.items()
    }
    totals: dict[int, int | None] = {}
    for macro_id in dependency_order(macros):
        each = tuple(_duration(command, actions, totals) for command in macros[macro_id].commands)
        found[macro_id] = each
        times = [time for time in each if time is not None]
        totals[macro_id] = sum(times) if len(times) == len(each) else None
    return found


def macro_seconds(project: Project) -> dict[int, float | None]:
    """Return the duration of each macro in seconds, by id; None for an unknown duration, as for `durations`."""
    return {
        macro_id: None if None in each else sum(time or 0 for time in each) / 1000
        for macro_id, each in durations(project).items()
    }


def wrong_durations(project: Project) -> Iterator[tuple[int, int, int]]:
    """Yield index of the macro, index of the command and right duration where `total_interval` is wrong.

    Deviations up to 10 ms or 1 % are accepted: programs round in different ways.
    """
    found, macros = durations(project), MACRO.by_id(project)
    for at, macro in enumerate(project.macros):
        if macros[macro.macro_id] is not macro:
            continue  # the id is used twice, so the macro meant is unknown
        for number, (command, takes) in enumerate(zip(macro.commands, found[macro.macro_id], strict=True)):
            if takes is not None and abs(command.total_interval - takes) > max(10, takes // 100):
                yield at, number, takes


def _duration(command: MacroCommand, actions: Mapping[int, Action], macros: Mapping[int, int | None]) -> int | None:
    once = _duration_once(command, actions, macros)
    if once is None or once < 0 or command.loop < 0 or command.ratio <= 0:
        return None
    half_up = (once * command.loop * 200 + command.ratio) // (2 * command.ratio)
    return half_up if half_up <= MAX_INTERVAL else None


def _duration_once(
    command: MacroCommand, actions: Mapping[int, Action], macros: Mapping[int, int | None]
) -> int | None:
    """Return the duration of a single loop at full speed, in milliseconds."""
    match command.type:
        case MacroCommandType.ACTION:
            action = actions.get(command.command_id)
            return None if action is None else 10 * max((step.interval for step in action.steps), default=0)
        case MacroCommandType.DELAY:
            return command.command_id
        case MacroCommandType.MACRO:
            return macros.get(command.command_id)
        case _:
            return None


_NUMBERED = re.compile(r"(action|macro|table):([0-9]{1,10})", re.ASCII)


def find(project: Project, name: str, kinds: Iterable[RecordType[Any]]) -> Any:
    """Return the record with this name: a caption, an id, a type and id as in `action:3`, or a caption as in `name:3`.

    Captions are compared as by `servolink.project.naming`. Raise ProjectError if no record matches, or several do.
    """
    kinds = tuple(kinds)
    records = [(kind, record) for kind in kinds for record in getattr(project, kind.field)]
    numbered = _NUMBERED.fullmatch(name)
    meant = int(numbered[2]) if numbered else id_or_caption(name)
    if isinstance(meant, int):
        word = numbered and numbered[1]
        found = [one for kind, one in records if kind.id_of(one) == meant and word in (None, _short_label(kind))]
    else:
        named = (Named(kind.label, at, kind.caption_of(one)) for at, (kind, one) in enumerate(records))
        found = [records[one.record_id][1] for one in captioned(named, meant)]
    if len(found) == 1:
        return found[0]
    labels = " or ".join(kind.label for kind in kinds)
    if found:
        ids = " or ".join(f"{_short_label(type_of(one))}:{type_of(one).id_of(one)}" for one in found)
        raise ProjectError(f"'{name}' may be {' or '.join(map(name_of, found))}; write {ids}")
    existing = [Named(kind.label, kind.id_of(record), kind.caption_of(record)) for kind, record in records]
    raise ProjectError(
        f"there is no {labels} '{name}'; {closest(existing, str(meant), 's or '.join(kind.label for kind in kinds))}"
    )


def find_servo(project: Project, servo: int | str) -> int:
    """Return the id of a servo, given by id or caption. Raise ProjectError unless exactly one servo matches."""
    meant = id_or_caption(servo) if isinstance(servo, str) else servo
    if isinstance(meant, int):
        return meant
    named = [Named("servo", one.servo_id, one.servo_caption) for one in project.servo_parameters]
    found = captioned(named, meant)
    if len(found) == 1:
        return found[0].record_id
    if found:
        raise ProjectError(f"'{servo}' may be {listed(found, 'or')}; give the id")
    raise ProjectError(f"there is no servo '{servo}'; {closest(named, meant, 'servo')}")


def _short_label(kind: RecordType[Any]) -> str:
    """Return the type word for names with a colon: `action`, `macro` or `table`."""
    return kind.label.split()[-1]
