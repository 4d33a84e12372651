"""How fast actions and macros ask servos to be."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from msgspec import Struct

from servolink.project.model import Project
from servolink.project.records import dependency_order, named
from servolink.protocol.record_types import ACTION, MACRO
from servolink.protocol.records import Action, Macro, MacroCommand


class ServoMove(Struct, frozen=True):
    """One servo's way from the pose before to that of a step."""

    path: str
    """Of the step, such as `actions[3].steps[6]`, or of the macro's command that leads to it."""
    action: Action
    at: int
    """Which of the action's steps, from 0."""
    start: int
    """Degrees, as all that follows: servos set to raw ADC are not for this."""
    seconds: float
    """With the ratio of the macro's command."""

    @property
    def servo_id(self) -> int:
        """The servo that turns."""
        return self.action.steps[self.at].servo_id

    @property
    def degrees_per_second(self) -> float:
        """The speed; infinite if there is a way and no time."""
        way = abs(self.action.steps[self.at].degree - self.start)
        if not way:
            return 0.0
        return way / self.seconds if self.seconds > 0 else math.inf

    def __str__(self) -> str:
        """Return such as "step 7 asks servo 3 for 310 degrees/s"."""
        speed = self.degrees_per_second
        wish = "to be there in no time" if math.isinf(speed) else f"for {speed:.3g} degrees/s"
        step = f"step {self.at + 1} asks servo {self.servo_id} {wish}"
        return step if self.path.startswith(ACTION.field) else f"{named(self.action)}, {step}"


@dataclass
class _Effect:
    """What an action or a macro does to the pose that it finds."""

    first: dict[int, tuple[Action, int, float]] = field(default_factory=dict)
    """By servo: the action and its step that moves it first, and the seconds for that."""
    last: dict[int, int] = field(default_factory=dict)
    """By servo: the degree at which it leaves it."""


def servo_moves(project: Project, start: Mapping[int, int] | None = None) -> Iterator[ServoMove]:
    """Yield each way for which the pose before is known: of macros, and of what begins from the pose `start`.

    A macro that is called is looked at by itself, at full speed, and again where it begins and where it repeats.
    """
    before = start or {}
    actions, macros = ACTION.by_id(project), MACRO.by_id(project)
    effects = {action_id: _of_action(action) for action_id, action in actions.items()}
    for at, action in enumerate(project.actions):
        for servo_id, (_, step, seconds) in _of_action(action).first.items():
            if servo_id in before:
                yield ServoMove(f"actions[{at}].steps[{step}]", action, step, before[servo_id], seconds)
    places = {macro.macro_id: f"macros[{at}]" for at, macro in enumerate(project.macros)}
    of_macros: dict[int, _Effect] = {}
    for macro_id in dependency_order(macros):
        of_macros[macro_id] = _Effect()
        called = [_called(command, effects, of_macros) for command in macros[macro_id].commands]
        yield from _of_macro(places[macro_id], macros[macro_id], called, before, of_macros[macro_id])


def _of_action(action: Action) -> _Effect:
    """Return the effect of an action, in which the last of several steps for one servo counts."""
    return _Effect(
        {step.servo_id: (action, at, max(step.interval, 0) / 100) for at, step in enumerate(action.steps)},
        {step.servo_id: step.degree for step in action.steps},
    )


def _called(command: MacroCommand, actions: Mapping[int, _Effect], macros: Mapping[int, _Effect]) -> _Effect:
    known = {0: actions, 2: macros}.get(command.type, {})
    return known.get(command.command_id, _Effect()) if command.ratio > 0 else _Effect()


def _of_macro(
    place: str, macro: Macro, called: list[_Effect], before: Mapping[int, int], whole: _Effect
) -> Iterator[ServoMove]:
    """Yield the ways between the commands of a macro, and put the effect of all of them into `whole`."""
    for at, (command, effect) in enumerate(zip(macro.commands, called, strict=True)):
        for _ in range(min(command.loop, 2)):  # all further loops find what the second finds
            for servo_id, (action, step, seconds) in effect.first.items():
                slowed = seconds * 100 / command.ratio
                whole.first.setdefault(servo_id, (action, step, slowed))
                start = whole.last.get(servo_id, before.get(servo_id))
                if start is not None:
                    yield ServoMove(f"{place}.commands[{at}]", action, step, start, slowed)
            whole.last |= effect.last
