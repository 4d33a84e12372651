"""Moments of a run: which command and which action of a record are running."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from servolink.project import Project, RecordRun, name_of
from servolink.protocol import ACTION, MACRO, Action, Macro, MacroCommand, MacroCommandType

AFTER = "after the end"
"""Moment after the last command."""


class Moment(NamedTuple):
    """Part of a run that is running."""

    command: int | None
    """Number of the command of the macro, from 1; None for an action, and after the end."""
    step: str
    """Text for people, such as "command 2, action 5 'Bow'"."""


def moment(project: Project, record: Action | Macro, seconds: float) -> Moment:
    """Return the part of a run that is running after `seconds`.

    Every record needed must be present, and no macro may run itself.
    """
    if isinstance(record, Action):
        return Moment(None, name_of(record) if seconds <= record.seconds else AFTER)
    lasts = RecordRun(project, record).command_seconds()
    return _MomentRun(ACTION.by_id(project), MACRO.by_id(project), lasts).in_macro(record.macro_id, seconds, 1.0)


class _MomentRun(NamedTuple):
    """Records of a project, with the seconds of each command: played through, nested loops would take for ever."""

    actions: Mapping[int, Action]
    macros: Mapping[int, Macro]
    lasts: Mapping[int, Sequence[float]]
    """Seconds of each command at full speed, by macro id."""

    def in_macro(self, macro_id: int, seconds: float, speed: float) -> Moment:
        """Return the part of a macro that is running after `seconds` at a speed."""
        commands = zip(self.macros[macro_id].commands, self.lasts[macro_id], strict=True)
        for number, (command, lasts) in enumerate(commands, 1):
            if seconds <= lasts / speed:
                return Moment(number, f"command {number}, {self._in_command(command, seconds, speed)}")
            seconds -= lasts / speed
        return Moment(None, AFTER)

    def _in_command(self, command: MacroCommand, seconds: float, speed: float) -> str:
        if command.type == MacroCommandType.DELAY:
            return "a pause"
        if command.type == MacroCommandType.ACTION:
            return name_of(self.actions[command.command_id])
        inner, faster = self.macros[command.command_id], speed * command.ratio / 100
        once = sum(self.lasts[inner.macro_id]) / faster
        within = self.in_macro(inner.macro_id, seconds % once if once else 0.0, faster)
        return name_of(inner) if within.command is None else f"{name_of(inner)}, {within.step}"
