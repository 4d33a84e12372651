"""What macros and buttons start that is not there, and what never ends."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from servolink.project.checks.problem import Problem
from servolink.project.kinds import ACTION, MACRO
from servolink.project.model import Project
from servolink.project.records import calls, named
from servolink.project.times import callees_first
from servolink.protocol.editing import Macro
from servolink.protocol.joystick import Button

_STARTS = tuple(name for name in Button.__struct_fields__ if name.endswith("_macro"))
_NAMED = 6
"""Macros of a cycle that are named."""


def wrong_calls(project: Project) -> Iterator[Problem]:
    """Yield calls of what is not there, macros that never end, and buttons that start nothing."""
    action_ids, macros = ACTION.of(project).keys(), MACRO.of(project)
    for at, macro in enumerate(project.macros):
        for number, command in enumerate(macro.commands):
            path = f"macros[{at}].commands[{number}]"
            if command.type == 0 and command.command_id not in action_ids:
                yield Problem(f"{path}.action_id", f"there is no action {command.command_id}", "warning")
            if command.type == 2 and command.command_id not in macros:
                yield Problem(f"{path}.macro_id", f"there is no macro {command.command_id}", "warning")
    yield from _endless(project, macros)
    for at, table in enumerate(project.joystick_tables):
        for number, button in enumerate(table.buttons):
            yield from _wrong_button(f"joystick_tables[{at}].buttons[{number}]", button, macros)


def _endless(project: Project, macros: Mapping[int, Macro]) -> Iterator[Problem]:
    """Name macros that call themselves, also through others: of those that have macros in common, one way round."""
    ends = set(callees_first(macros))
    goes_on = {
        macro_id: next(
            called for kind, called in calls(macro) if kind is MACRO and called in macros and called not in ends
        )
        for macro_id, macro in macros.items()
        if macro_id not in ends
    }
    places = {macro.macro_id: at for at, macro in enumerate(project.macros)}
    seen: set[int] = set()
    for macro_id in goes_on:
        way: dict[int, None] = {}  # in order, and quick to look into
        here = macro_id
        while here not in seen:
            seen.add(here)
            way[here] = None
            here = goes_on[here]
        if here in way:
            cycle = list(way)[list(way).index(here) :]
            calling = (one.type == 2 and one.command_id == goes_on[here] for one in macros[here].commands)
            path = f"macros[{places[here]}].commands[{list(calling).index(True)}].macro_id"
            yield Problem(path, f"{named(macros[here])} calls itself{_round(cycle)}, so it never ends", "error")


def _round(cycle: list[int]) -> str:
    """Return the way round a cycle, such as ` (1 -> 2 -> 3 -> 1)`; nothing for a macro that calls just itself."""
    if len(cycle) == 1:
        return ""
    between = ["..."] if len(cycle) > _NAMED else []
    return f" ({' -> '.join([*map(str, cycle[:_NAMED]), *between, str(cycle[0])])})"


def _wrong_button(path: str, button: Button, macros: Mapping[int, Macro]) -> Iterator[Problem]:
    starts = {name: getattr(button, name) for name in _STARTS}
    if not any(starts.values()):
        yield Problem(path, f"button {button.button_id} starts no macro", "warning")
    for name, macro_id in starts.items():
        if macro_id and macro_id not in macros:
            yield Problem(f"{path}.{name}", f"there is no macro {macro_id}", "warning")
