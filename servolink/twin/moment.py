"""Moment of a run: which command and which action of a record are running."""

from __future__ import annotations

from typing import NamedTuple

from msgspec.structs import replace

from servolink.project.model import Project
from servolink.project.record_lookup import name_of
from servolink.protocol.record_types import ACTION, MACRO
from servolink.protocol.records import Action, Macro, MacroCommand, MacroCommandType, MacroPlaying

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
    playing = MacroPlaying(ACTION.by_id(project), dict(MACRO.by_id(project)), lambda steps, speed: None)
    return _in_macro(playing, record, seconds, 1.0)


def _in_macro(playing: MacroPlaying, macro: Macro, seconds: float, speed: float) -> Moment:
    for number, command in enumerate(macro.commands, 1):
        lasts = _duration(playing, macro, (command,), speed)
        if seconds <= lasts:
            return Moment(number, f"command {number}, {_in_command(playing, macro, command, seconds, speed)}")
        seconds -= lasts
    return Moment(None, AFTER)


def _in_command(playing: MacroPlaying, macro: Macro, command: MacroCommand, seconds: float, speed: float) -> str:
    if command.type == MacroCommandType.DELAY:
        return "a pause"
    if command.type == MacroCommandType.ACTION:
        return name_of(playing.actions[command.command_id])
    inner, faster = playing.macros[command.command_id], speed * command.ratio / 100
    once = _duration(playing, inner, inner.commands, faster)
    within = _in_macro(playing, inner, seconds % once if once else 0.0, faster)
    return name_of(inner) if within.command is None else f"{name_of(inner)}, {within.step}"


def _duration(playing: MacroPlaying, macro: Macro, commands: tuple[MacroCommand, ...], speed: float) -> float:
    """Return the duration in seconds of some commands of a macro."""
    some = replace(macro, commands=commands)
    played = MacroPlaying(playing.actions, {**playing.macros, macro.macro_id: some}, playing.move)
    return sum(played.play(macro.macro_id, speed))
