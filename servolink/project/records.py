"""What actions, macros and joystick tables have to do with each other: ids, and who calls whom."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import suppress
from graphlib import CycleError, TopologicalSorter
from itertools import chain, count
from typing import Any

import msgspec

from servolink.errors import ProjectError
from servolink.escaping import escape
from servolink.project.model import Project, telling
from servolink.protocol.record_types import ACTION, MACRO, RECORD_TYPES, Record, RecordType, stored_size, type_of
from servolink.protocol.records import Action, Macro, MacroCommand, ServoParameter


def named(record: Any) -> str:
    """Return what a record is called in texts: `action 3 'Wave'`."""
    kind = type_of(record)
    return f"{kind.label} {kind.id_of(record)} '{escape(kind.caption_of(record))}'"


def by_kind(project: Project) -> dict[str, dict[int, Any]]:
    """Return the records of a project, by the field that they are in and their id; ProjectError for an id twice."""
    for kind in RECORD_TYPES:
        _refuse_twice(kind.label, [kind.id_of(record) for record in getattr(project, kind.field)])
    return {kind.field: kind.by_id(project) for kind in RECORD_TYPES}


def by_servo(project: Project) -> dict[int, ServoParameter]:
    """Return the parameters of servos, by servo; ProjectError for a servo that has them twice."""
    _refuse_twice("servo", [one.servo_id for one in project.servo_parameters])
    return {one.servo_id: one for one in project.servo_parameters}


def _refuse_twice(word: str, ids: list[int]) -> None:
    """Refuse what an edit would lose."""
    if twice := [number for number, times in Counter(ids).items() if times > 1]:
        raise ProjectError(f"{word} {twice[0]} is there twice: which one is meant cannot be known")


def with_records(project: Project, records: Mapping[str, Mapping[int, Any]]) -> Project:
    """Return `project` with other records, given as `by_kind` gives them."""
    return msgspec.structs.replace(project, **{plural: tuple(shelf.values()) for plural, shelf in records.items()})


def free_id(taken: Container[int]) -> int:
    """Return the lowest id that is not taken; 0 means "there is none" everywhere."""
    return next(number for number in count(1) if number not in taken)


def with_id(record: Any, record_id: int) -> Any:
    """Return `record` under another id."""
    return msgspec.structs.replace(record, **{record.__struct_fields__[0]: record_id})


def total_size(project: Project) -> int:
    """Return the bytes of everything in `project` that is stored, ids and the choice of a table left out."""
    records: Iterable[Record | ServoParameter] = chain(
        telling(project.servo_parameters), project.actions, project.macros, project.joystick_tables
    )
    return sum(stored_size(record) for record in records)


LONGEST = 0x7FFF_FFFF
"""Milliseconds that `total_interval` can say, nearly 25 days."""


def dependency_order(macros: Mapping[int, Macro]) -> list[int]:
    """Return the ids of macros, each behind those that it calls; without those that never end."""
    sorter = TopologicalSorter(
        {
            macro_id: {called for kind, called in MACRO.references(macro) if kind is MACRO and called in macros}
            for macro_id, macro in macros.items()
        }
    )
    with suppress(CycleError):  # what leads to no cycle is given all the same
        sorter.prepare()
    found: list[int] = []
    while ready := sorter.get_ready():
        found += ready
        sorter.done(*ready)
    return found


def durations(project: Project) -> dict[int, tuple[int | None, ...]]:
    """Return, by macro, how many milliseconds each command takes with its ratio and loops: its `total_interval`.

    None: it cannot be known, because it calls what is not there or never ends, or is longer than `LONGEST`.
    """
    actions, macros = ACTION.by_id(project), MACRO.by_id(project)
    found: dict[int, tuple[int | None, ...]] = {
        macro_id: (None,) * len(macro.commands) for macro_id, macro in macros.items()
    }
    whole: dict[int, int | None] = {}
    for macro_id in dependency_order(macros):
        each = tuple(_time(command, actions, whole) for command in macros[macro_id].commands)
        found[macro_id] = each
        known = [time for time in each if time is not None]
        whole[macro_id] = sum(known) if len(known) == len(each) else None
    return found


def wrong_times(project: Project) -> Iterator[tuple[int, int, int]]:
    """Yield which macro and which of its commands, both from 0, says another time than it takes, and what it takes.

    Another is one that is more than 10 ms and more than 1 % off: programs differ in how they round.
    """
    found, macros = durations(project), MACRO.by_id(project)
    for at, macro in enumerate(project.macros):
        if macros[macro.macro_id] is not macro:
            continue  # its id is there twice, so nobody knows which one is called
        for number, (command, takes) in enumerate(zip(macro.commands, found[macro.macro_id], strict=True)):
            if takes is not None and abs(command.total_interval - takes) > max(10, takes // 100):
                yield at, number, takes


def _time(command: MacroCommand, actions: Mapping[int, Action], macros: Mapping[int, int | None]) -> int | None:
    once = _once(command, actions, macros)
    if once is None or once < 0 or command.loop < 0 or command.ratio <= 0:
        return None
    half_up = (once * command.loop * 200 + command.ratio) // (2 * command.ratio)
    return half_up if half_up <= LONGEST else None


def _once(command: MacroCommand, actions: Mapping[int, Action], macros: Mapping[int, int | None]) -> int | None:
    """Return the milliseconds at full speed."""
    match command.type:
        case 0:
            action = actions.get(command.command_id)
            return None if action is None else 10 * max((step.interval for step in action.steps), default=0)
        case 1:
            return command.command_id
        case 2:
            return macros.get(command.command_id)
        case _:
            return None


_NUMBERED = re.compile(r"(?:([a-z]+):)?([0-9]{1,10})", re.ASCII)


def find(project: Project, name: str, kinds: Iterable[RecordType[Any]]) -> Any:
    """Return the record that `name` means: a caption, an id, or an id behind its kind, as in `action:3`.

    ProjectError if there is none, or more than one.
    """
    kinds = tuple(kinds)
    numbered = _NUMBERED.fullmatch(name)
    word, number = (numbered[1] or "", int(numbered[2])) if numbered else ("", -1)
    records = [(kind, record) for kind in kinds for record in getattr(project, kind.field)]
    found = [
        record
        for kind, record in records
        if kind.caption_of(record) == name or (kind.id_of(record) == number and word in ("", kind.label.split()[-1]))
    ]
    if not found:
        found = [record for kind, record in records if kind.caption_of(record).casefold() == name.casefold()]
    if len(found) == 1:
        return found[0]
    if found:
        raise ProjectError(f"'{escape(name)}' may be {' or '.join(map(named, found))}: write it as in action:3")
    words = " or ".join(kind.label for kind in kinds)
    there = ", ".join(named(record) for _, record in records[:10]) + (", ..." if len(records) > 10 else "")
    raise ProjectError(f"there is no {words} '{escape(name)}'; there is {there or 'none at all'}")
