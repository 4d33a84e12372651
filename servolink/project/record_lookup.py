"""Computations on records of projects: free ids, order, and durations."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from contextlib import suppress
from graphlib import CycleError, TopologicalSorter
from itertools import count
from typing import Any

from msgspec.structs import replace

from servolink.project.model import Project
from servolink.protocol import (
    ACTION,
    MACRO,
    Action,
    Macro,
    MacroCommand,
    MacroCommandType,
)

MAX_INTERVAL = 0x7FFF_FFFF
"""Maximum of `total_interval` in milliseconds, nearly 25 days."""


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
