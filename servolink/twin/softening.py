"""Softer macros: the least slowing, or else the largest angles, with which a robot stands."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

from msgspec.structs import replace

from servolink.project import Project, dependency_order, fix_project, name_of
from servolink.protocol import MACRO, Action, Macro, MacroCommand, MacroCommandType
from servolink.twin.body import Body
from servolink.twin.forecasts import VARIATIONS
from servolink.twin.simulation import Physics
from servolink.twin.trial import Variation, run_seconds, run_trial

SPEEDS: Final = tuple(range(95, 20, -5))
"""Speeds of a macro that are tried, in percent of the speed before."""
AMPLITUDES: Final = tuple(range(95, 25, -5))
"""Angles of the actions of a macro that are tried where no slowing helps, in percent of the angles before."""


class Softened(NamedTuple):
    """Project in which some macros are softer."""

    project: Project
    changes: tuple[str, ...]
    """Texts for people, one for each change."""
    unsolved: tuple[Macro, ...]
    """Macros in which the robot falls at each speed and with all angles that were tried."""

    @property
    def tried(self) -> str:
        """Text for people about what was tried for these macros."""
        return f"no speed down to {SPEEDS[-1]} % and no angles down to {AMPLITUDES[-1]} %"


def soften(project: Project, body: Body, macros: Iterable[Macro]) -> Softened:
    """Return a project in which the robot stands in `macros`, with all variations of the body.

    A macro in which the robot stands is left alone. A slower macro has lower ratios, and changes no other record.
    Smaller angles change the actions of the macro, and so all other macros with these actions.

    Raises:
        ProjectError: No board could play one of the macros.
        TwinError: MuJoCo is missing, or parts of the body overlap.
    """
    physics = Physics(body)
    wanted = {macro.macro_id for macro in macros}
    changes, unsolved = list[str](), list[Macro]()
    for macro_id in dependency_order(MACRO.by_id(project)):  # inner macros first: softer ones may be enough
        if macro_id not in wanted:
            continue
        hardest = list(VARIATIONS)
        if _stands(physics, project, macro_id, hardest):
            continue
        macro = MACRO.by_id(project)[macro_id]
        for softer, change in _softer(project, macro):
            if _stands(physics, softer, macro_id, hardest):
                project, fixes = fix_project(softer)
                changes += [change, *fixes]
                break
        else:
            unsolved.append(macro)
    return Softened(project, tuple(changes), tuple(unsolved))


def _stands(physics: Physics, project: Project, macro_id: int, variations: list[Variation]) -> bool:
    """Return whether the robot stands with all variations; the first with a fall moves to the front of the list."""
    macro = MACRO.by_id(project)[macro_id]
    seconds = run_seconds(project, macro)
    for variation in variations:
        if run_trial(physics, project, macro, variation, seconds).fall is not None:
            variations.remove(variation)
            variations.insert(0, variation)
            return False
    return True


def _softer(project: Project, macro: Macro) -> Iterator[tuple[Project, str]]:
    """Yield projects with softer versions of a macro, the least change first, each with a text for people."""
    for speed in SPEEDS:
        slower = replace(macro, commands=tuple(_slower(command, speed) for command in macro.commands))
        macros = tuple(slower if one.macro_id == macro.macro_id else one for one in project.macros)
        yield replace(project, macros=macros), f"{name_of(macro)}: speed of its commands multiplied by {speed / 100:g}"
    used = [record for record in project.with_dependencies([macro]) if isinstance(record, Action)]
    names = ", ".join(map(name_of, used))
    for amplitude in AMPLITUDES:
        actions = tuple(_smaller(one, amplitude) if one in used else one for one in project.actions)
        yield (
            replace(project, actions=actions),
            f"{name_of(macro)}: angles of {names} multiplied by {amplitude / 100:g}",
        )


def _slower(command: MacroCommand, speed: int) -> MacroCommand:
    if command.type == MacroCommandType.DELAY:
        return command
    return replace(command, ratio=max(1, round(command.ratio * speed / 100)))


def _smaller(action: Action, amplitude: int) -> Action:
    steps = tuple(replace(step, degree=round(step.degree * amplitude / 100)) for step in action.steps)
    return replace(action, steps=steps)
