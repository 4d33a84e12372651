"""Speed of servos in actions and macros."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from msgspec import Struct
from msgspec.structs import replace

from servolink.motion import INTERVAL_UNIT, degrees_per_second
from servolink.project.model import Project, name_of
from servolink.project.record_lookup import dependency_order
from servolink.protocol import ACTION, MACRO, Action, Macro, MacroCommand, MacroCommandType, Step


class ServoMove(Struct, frozen=True):
    """Turn of a servo, from the pose before a step to the angle of the step.

    Angles are in degrees. Servos set to raw ADC must be left out.
    """

    path: str
    """Place of the step, such as `actions[3].steps[6]`, or of the macro command with the step.

    Empty for the step of an action outside a macro.
    """
    action: Action
    at: int
    """Index of the step in the action."""
    start: int
    seconds: float
    """Duration with the ratio of the macro command, seconds."""

    @property
    def step(self) -> Step:
        """Step of the action."""
        return self.action.steps[self.at]

    @property
    def degrees(self) -> int:
        """Angle between start and end, never negative."""
        return abs(self.step.degree - self.start)

    @property
    def degrees_per_second(self) -> float:
        """Speed of the turn; 0 for no turn, infinite for no time."""
        return degrees_per_second(self.degrees, self.seconds)

    def __str__(self) -> str:
        """Return a text such as "step 7 asks servo 3 for 310 degrees/s"."""
        speed = self.degrees_per_second
        request = "to turn in no time" if math.isinf(speed) else f"for {speed:.3g} degrees/s"
        text = f"step {self.at + 1} asks servo {self.step.servo_id} {request}"
        return text if self.path.startswith(ACTION.field) else f"{name_of(self.action)}, {text}"


@dataclass(slots=True)
class _Poses:
    """Poses that an action or a macro begins and ends with."""

    first: dict[int, tuple[Action, int, float]] = field(default_factory=dict)
    """First step of each servo, by servo id: the action, the index of the step, and the duration in seconds."""
    last: dict[int, int] = field(default_factory=dict)
    """Final angle of each servo, by servo id."""


def servo_moves(
    project: Project, start: Mapping[int, int] | None = None, interval_unit: float = INTERVAL_UNIT
) -> Iterator[ServoMove]:
    """Yield each turn with a known pose before: within macros, and from the pose `start`.

    `start` holds degrees by servo id. A macro run by another macro is checked twice: separately, at full speed, and
    at the places where the other macro begins or repeats the inner macro.
    """
    before = start or {}
    actions, macros = ACTION.by_id(project), MACRO.by_id(project)
    effects = {action_id: _effect_of(action, interval_unit) for action_id, action in actions.items()}
    for at, action in enumerate(project.actions):
        for servo_id, (_, step, seconds) in _effect_of(action, interval_unit).first.items():
            if servo_id in before:
                yield ServoMove(f"actions[{at}].steps[{step}]", action, step, before[servo_id], seconds)
    places = {macro.macro_id: f"macros[{at}]" for at, macro in enumerate(project.macros)}
    macro_effects: dict[int, _Poses] = {}
    for macro_id in dependency_order(macros):
        macro_effects[macro_id] = _Poses()
        called = [_called(command, effects, macro_effects) for command in macros[macro_id].commands]
        place = f"{places[macro_id]}.commands[{{}}]".format
        yield from _moves_of_macro(place, macros[macro_id], called, before, macro_effects[macro_id])


class RecordRun:
    """Run of an action or a macro, with all records run by the macro.

    `stored` holds these records, each once, without macros that run themselves. An interval of 1 stands for
    `interval_unit` seconds.
    """

    def __init__(self, stored: Project, record: Action | Macro, interval_unit: float = INTERVAL_UNIT) -> None:
        self.stored = stored
        self.record = record
        self._interval_unit = interval_unit
        self._macros = MACRO.by_id(stored)
        self._order = dependency_order(self._macros)
        self._actions = {one.action_id: _effect_of(one, interval_unit) for one in stored.actions}
        self._effects: dict[int, _Poses] = {}
        self._turns: dict[int, list[ServoMove]] = {}  # within each macro, from an unknown pose
        for macro_id in self._order:
            self._turns[macro_id], self._effects[macro_id] = self._play(macro_id, {})

    def first_pose(self) -> dict[int, int]:
        """Return the first target angle of each servo, by servo id."""
        record = self.record
        effect = self._actions[record.action_id] if isinstance(record, Action) else self._effects[record.macro_id]
        return {servo_id: action.steps[at].degree for servo_id, (action, at, _) in effect.first.items()}

    def last_pose(self) -> dict[int, int]:
        """Return the last target angle of each servo, by servo id."""
        record = self.record
        effect = self._actions[record.action_id] if isinstance(record, Action) else self._effects[record.macro_id]
        return dict(effect.last)

    def servo_ids(self) -> set[int]:
        """Return the ids of all servos moved in the run."""
        return {step.servo_id for action in self.stored.actions for step in action.steps}

    def known_seconds(self) -> float | None:
        """Return the duration of the run in seconds, None for an endless macro."""
        is_endless = isinstance(self.record, Macro) and self.record.macro_id not in self._order
        return None if is_endless else self.seconds()

    def seconds(self) -> float:
        """Return the duration of the run in seconds."""
        if isinstance(self.record, Action):
            return self._seconds_of(self.record)
        return round(sum(self.command_seconds()[self.record.macro_id]), 9)

    def command_seconds(self) -> dict[int, list[float]]:
        """Return the seconds of each command at full speed, by macro id, as `MacroPlaying` plays them.

        A command lasts `total_interval`, or as long as the contents. A record that is missing takes no time.
        """
        actions = {one.action_id: self._seconds_of(one) for one in self.stored.actions}
        lasts: dict[int, list[float]] = {}
        macros: dict[int, float] = {}
        for macro_id in self._order:
            lasts[macro_id] = [_command_seconds(one, actions, macros) for one in self._macros[macro_id].commands]
            macros[macro_id] = sum(lasts[macro_id])
        return lasts

    def _seconds_of(self, action: Action) -> float:
        return round(max((step.interval for step in action.steps), default=0) * self._interval_unit, 9)

    def moves(self, start: Mapping[int, int]) -> Iterator[ServoMove]:
        """Yield each turn, at the highest speed in the run, from the pose `start`, degrees by servo id.

        The place of a turn is the name of the macro and the number of the command.
        """
        if isinstance(self.record, Action):
            for servo_id, (action, at, seconds) in self._actions[self.record.action_id].first.items():
                if servo_id in start:
                    yield ServoMove("", action, at, start[servo_id], seconds)
            return
        yield from self._play(self.record.macro_id, start)[0]
        for macro_id, speed in self._speeds(self.record.macro_id).items():
            if macro_id != self.record.macro_id:
                yield from (replace(move, seconds=move.seconds / speed) for move in self._turns[macro_id])

    def _play(self, macro_id: int, start: Mapping[int, int]) -> tuple[list[ServoMove], _Poses]:
        """Return the turns of a macro at full speed, without the turns inside inner macros, and the effect."""
        macro, effect = self._macros[macro_id], _Poses()
        called = [_called(command, self._actions, self._effects) for command in macro.commands]
        name = name_of(macro)
        turns = _moves_of_macro(lambda at: f"{name}, command {at + 1}", macro, called, start, effect)
        return list(turns), effect

    def slowest(self) -> Iterator[tuple[Action, float]]:
        """Yield each action of the run, with the lowest speed factor in the run, at most 1."""
        if isinstance(self.record, Action):
            yield self.record, 1.0
            return
        lowest: dict[int, float] = {}
        for macro_id, speed in self._speeds(self.record.macro_id, min).items():
            for command in self._macros[macro_id].commands:
                if command.type == MacroCommandType.ACTION and command.loop > 0 and command.ratio > 0:
                    slowed = speed * command.ratio / 100
                    lowest[command.command_id] = min(lowest.get(command.command_id, slowed), slowed)
        actions = ACTION.by_id(self.stored)
        yield from ((actions[action_id], speed) for action_id, speed in lowest.items())

    def _speeds(self, macro_id: int, of_two: Callable[[float, float], float] = max) -> dict[int, float]:
        """Return the speed factor, at most 1, of a macro and of all inner macros, by macro id.

        Of several speeds for a macro, the highest counts; with `min` as `of_two`, the lowest.
        """
        speeds = {macro_id: 1.0}
        for caller in reversed(self._order):
            for command in self._macros[caller].commands if caller in speeds else ():
                if command.type == MacroCommandType.MACRO and command.loop > 0 and command.ratio > 0:
                    speed = speeds[caller] * command.ratio / 100
                    speeds[command.command_id] = of_two(speeds.get(command.command_id, speed), speed)
        return speeds


def _effect_of(action: Action, interval_unit: float) -> _Poses:
    """Return the effect of an action. Of several steps for a servo, the last counts."""
    return _Poses(
        {
            step.servo_id: (action, at, max(round(step.interval * interval_unit, 9), 0))
            for at, step in enumerate(action.steps)
        },
        {step.servo_id: step.degree for step in action.steps},
    )


def _called(command: MacroCommand, actions: Mapping[int, _Poses], macros: Mapping[int, _Poses]) -> _Poses:
    """Return the effect of the record run by a command, an empty effect for a delay or a missing record."""
    effects: dict[int, Mapping[int, _Poses]] = {MacroCommandType.ACTION: actions, MacroCommandType.MACRO: macros}
    called = effects.get(command.type, {})
    return called.get(command.command_id, _Poses()) if command.ratio > 0 else _Poses()


def _command_seconds(command: MacroCommand, actions: Mapping[int, float], macros: Mapping[int, float]) -> float:
    """Return the duration of a command within a macro, in seconds."""
    match command.type:
        case MacroCommandType.ACTION:
            once = actions.get(command.command_id, 0.0)
        case MacroCommandType.MACRO:
            once = macros.get(command.command_id, 0.0)
        case MacroCommandType.DELAY:
            once = max(command.command_id, 0) / 1000
        case _:  # a type unknown to the document
            once = 0.0
    looped = once * max(command.loop, 0) * 100 / command.ratio if command.ratio > 0 else 0.0
    return max(looped, command.total_interval / 1000)


def _moves_of_macro(
    place: Callable[[int], str], macro: Macro, called: list[_Poses], before: Mapping[int, int], whole: _Poses
) -> Iterator[ServoMove]:
    """Yield the turns where the commands of a macro meet, and store the effect of all commands in `whole`.

    `place` names the place of a command by its index.
    """
    for at, (command, effect) in enumerate(zip(macro.commands, called, strict=True)):
        for _ in range(min(command.loop, 2)):  # every later loop starts from the same pose as the second
            for servo_id, (action, step, seconds) in effect.first.items():
                slowed = seconds * 100 / command.ratio
                whole.first.setdefault(servo_id, (action, step, slowed))
                start = whole.last.get(servo_id, before.get(servo_id))
                if start is not None:
                    yield ServoMove(place(at), action, step, start, slowed)
            whole.last |= effect.last
