"""Duration of a run, and its moments: which command and which action of a record are running."""

from __future__ import annotations

from typing import NamedTuple

from servolink.project import Project, dependency_order, name_of
from servolink.protocol import ACTION, MACRO, Action, Macro, MacroCommand, MacroCommandType

AFTER = "after the end"
"""Moment after the last command."""


class Moment(NamedTuple):
    """Part of a run that is running."""

    command: int | None
    """Number of the command of the macro, from 1; None for an action, and after the end."""
    step: str
    """Text for people, such as "command 2, action 5 'Bow'"."""


def duration(project: Project, record: Action | Macro) -> float:
    """Return the seconds of a run. Every record needed must be present, and no macro may run itself."""
    return record.seconds if isinstance(record, Action) else _MomentRun(project).seconds(record.macro_id)


def moment(project: Project, record: Action | Macro, seconds: float) -> Moment:
    """Return the part of a run that is running after `seconds`.

    Every record needed must be present, and no macro may run itself.
    """
    if isinstance(record, Action):
        return Moment(None, name_of(record) if seconds <= record.seconds else AFTER)
    return _MomentRun(project).in_macro(record.macro_id, seconds, 1.0)


class _MomentRun:
    """Records of a project, with the seconds of each command: played through, nested loops would take for ever."""

    def __init__(self, project: Project) -> None:
        self._actions, self._macros = ACTION.by_id(project), MACRO.by_id(project)
        self._lasts: dict[int, list[float]] = {}  # at full speed
        for macro_id in dependency_order(self._macros):
            self._lasts[macro_id] = [self._seconds_of(command) for command in self._macros[macro_id].commands]

    def seconds(self, macro_id: int) -> float:
        """Return the duration of a macro at full speed."""
        return sum(self._lasts[macro_id])

    def in_macro(self, macro_id: int, seconds: float, speed: float) -> Moment:
        """Return the part of a macro that is running after `seconds` at a speed."""
        commands = zip(self._macros[macro_id].commands, self._lasts[macro_id], strict=True)
        for number, (command, lasts) in enumerate(commands, 1):
            if seconds <= lasts / speed:
                return Moment(number, f"command {number}, {self._in_command(command, seconds, speed)}")
            seconds -= lasts / speed
        return Moment(None, AFTER)

    def _in_command(self, command: MacroCommand, seconds: float, speed: float) -> str:
        if command.type == MacroCommandType.DELAY:
            return "a pause"
        if command.type == MacroCommandType.ACTION:
            return name_of(self._actions[command.command_id])
        inner, faster = self._macros[command.command_id], speed * command.ratio / 100
        once = self.seconds(inner.macro_id) / faster
        within = self.in_macro(inner.macro_id, seconds % once if once else 0.0, faster)
        return name_of(inner) if within.command is None else f"{name_of(inner)}, {within.step}"

    def _seconds_of(self, command: MacroCommand) -> float:
        """Return the duration of a command as `MacroPlaying` plays it; a record that is missing takes no time."""
        if command.type == MacroCommandType.MACRO:
            once = sum(self._lasts.get(command.command_id, ()))
        elif command.type == MacroCommandType.DELAY:
            once = command.command_id / 1000
        else:
            action = self._actions.get(command.command_id)
            once = 0.0 if action is None else action.seconds
        return max(command.total_interval / 1000, once * command.loop * 100 / max(command.ratio, 1))
