"""How long the commands of macros take."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from graphlib import CycleError, TopologicalSorter

from servolink.project.kinds import ACTION, MACRO
from servolink.project.model import Project
from servolink.project.records import calls
from servolink.protocol.editing import Action, Macro, MacroCommand

LONGEST = 0x7FFF_FFFF
"""Milliseconds that `total_interval` can say, nearly 25 days."""


def callees_first(macros: Mapping[int, Macro]) -> list[int]:
    """Return the ids of macros, each behind those that it calls; without those that never end."""
    sorter = TopologicalSorter(
        {
            macro_id: {called for kind, called in calls(macro) if kind is MACRO and called in macros}
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


def times(project: Project) -> dict[int, tuple[int | None, ...]]:
    """Return, by macro, how many milliseconds each command takes with its ratio and loops: its `total_interval`.

    None: it cannot be known, because it calls what is not there or never ends, or is longer than `LONGEST`.
    """
    actions, macros = ACTION.of(project), MACRO.of(project)
    found: dict[int, tuple[int | None, ...]] = {
        macro_id: (None,) * len(macro.commands) for macro_id, macro in macros.items()
    }
    whole: dict[int, int | None] = {}
    for macro_id in callees_first(macros):
        each = tuple(_time(command, actions, whole) for command in macros[macro_id].commands)
        found[macro_id] = each
        known = [time for time in each if time is not None]
        whole[macro_id] = sum(known) if len(known) == len(each) else None
    return found


def wrong_times(project: Project) -> Iterator[tuple[int, int, int]]:
    """Yield which macro and which of its commands, both from 0, says another time than it takes, and what it takes.

    Another is one that is more than 10 ms and more than 1 % off: programs differ in how they round.
    """
    found, macros = times(project), MACRO.of(project)
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
