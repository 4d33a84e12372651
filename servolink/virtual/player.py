"""Stored actions and macros, run in time."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field

from servolink.protocol.codec import Codec, in_range
from servolink.protocol.editing import AddActionRequest, AddMacroRequest
from servolink.protocol.records import Action, Macro, MacroCommand, Step
from servolink.virtual.servo import Servo
from servolink.virtual.storage import Kind, Storage

ACTION, DELAY, MACRO = 0, 1, 2
"""Values of `MacroCommand.type`."""
MAX_NESTING = 32
"""How deep macros may run macros; a cycle is endlessly deep."""
STEP_UNIT = 0.01
"""Seconds in one unit of `Step.interval`."""

# There are macros with billions of commands that take no time, and hosts that sleep for hours while a macro runs:
# when so many commands and steps were done at one time, the macro goes on later, and late.
_WORK_AT_ONCE = 2000
_BREATH = 0.01


def playable(macro: AddMacroRequest) -> bool:
    """Tell whether all values of `macro` are allowed, and no delay is negative; a torn record is not like that."""
    return in_range(macro) and not any(command.type == DELAY and command.command_id < 0 for command in macro.commands)


class _Unplayable(Exception):
    """The macro needs something that is not stored, or runs itself."""


@dataclass(slots=True)
class _Score:
    """All that a macro needs, as it was when it was started: later edits leave a running macro alone."""

    actions: dict[int, Action] = field(default_factory=dict)
    macros: dict[int, Macro] = field(default_factory=dict)
    heights: dict[int, int] = field(default_factory=dict)


class Player:
    """Runs actions at once and one macro at a time."""

    def __init__(self, servos: Mapping[int, Servo], storage: Storage, codec: Codec) -> None:
        """Move `servos` as what is in `storage` says."""
        self._servos = servos
        self._storage = storage
        self._codec = codec
        self._running: Generator[float, None, float] | None = None
        self._at = 0.0  # the time at which the running macro goes on
        self._next = 0
        self._turn = 0.0
        self._work = 0  # commands and steps done in this turn
        self.macro_id = 0
        """The macro that runs, 0 if none does."""

    @property
    def due(self) -> float | None:
        """When the running macro goes on; None if none runs."""
        return None if self._running is None else self._at

    def move(self, steps: tuple[Step, ...], now: float, speed: float = 1.0) -> None:
        """Start all `steps` together; steps of servos that do not exist do nothing."""
        for step in steps:
            if (servo := self._servos.get(step.servo_id)) is not None:
                servo.move(step.degree, step.interval * STEP_UNIT / speed, now)
        self._work += len(steps)

    def run_action(self, action_id: int, now: float) -> None:
        """Run a stored action; nothing happens if there is none."""
        if (action := self._action(action_id)) is not None:
            self.move(action.steps, now)

    def run_macro(self, macro_id: int, now: float) -> bool:
        """Run a stored macro instead of the one that runs; False if it, or what it needs, is missing or a cycle."""
        score = _Score()
        try:
            self._collect(macro_id, score, above=0)
        except _Unplayable:
            return False
        self._running = self._play(score, macro_id, 1.0)
        self.macro_id, self._next, self._at = macro_id, 0, now
        return True

    def run_after(self, macro_id: int) -> None:
        """Run a stored macro when the one that runs has ended."""
        self._next = macro_id

    def stop(self) -> None:
        """End the running macro and forget the one after it; servos are left as they are."""
        self._running, self.macro_id, self._next = None, 0, 0

    def advance(self, until: float, now: float) -> None:
        """Do what the running macro does up to `until`, which is `now` or before it."""
        if now != self._turn:
            self._turn, self._work = now, 0
        while self._running is not None and self._at <= until:
            if self._work >= _WORK_AT_ONCE:
                self._at = now + _BREATH
                return
            self._work += 1
            try:
                self._at += next(self._running)
            except StopIteration:
                self._ended()

    def _ended(self) -> None:
        following, at = self._next, self._at
        self.stop()
        if following:
            self.run_macro(following, at)

    def _action(self, action_id: int) -> Action | None:
        content = self._storage.get(Kind.ACTION, action_id)
        if content is None:
            return None
        packet = self._codec.decode(AddActionRequest.packet_id, content)
        return packet if isinstance(packet, AddActionRequest) and in_range(packet) else None

    def _macro(self, macro_id: int) -> Macro | None:
        content = self._storage.get(Kind.MACRO, macro_id)
        if content is None:
            return None
        packet = self._codec.decode(AddMacroRequest.packet_id, content)
        return packet if isinstance(packet, AddMacroRequest) and playable(packet) else None

    def _collect(self, macro_id: int, score: _Score, above: int) -> int:
        """Put all that a macro needs into `score`; return how deep it nests, itself counted."""
        if (height := score.heights.get(macro_id)) is None:
            macro = self._macro(macro_id)
            if macro is None or above >= MAX_NESTING:
                raise _Unplayable
            score.macros[macro_id] = macro
            height = 1
            for command in macro.commands:
                if command.type == MACRO:
                    height = max(height, 1 + self._collect(command.command_id, score, above + 1))
                elif command.type == ACTION:
                    self._collect_action(command.command_id, score)
            score.heights[macro_id] = height
        if above + height > MAX_NESTING:
            raise _Unplayable
        return height

    def _collect_action(self, action_id: int, score: _Score) -> None:
        if action_id not in score.actions:
            if (action := self._action(action_id)) is None:
                raise _Unplayable
            score.actions[action_id] = action

    def _play(self, score: _Score, macro_id: int, speed: float) -> Generator[float, None, float]:
        """Run a macro, yielding each time to wait; return the time it took."""
        whole = 0.0
        for command in score.macros[macro_id].commands:
            yield 0.0
            took = 0.0
            for _ in range(command.loop):
                took += yield from self._once(score, command, speed * command.ratio / 100)
            rest = command.total_interval / 1000 / speed - took
            if rest > 0:
                yield rest
            whole += max(rest, 0.0) + took
        return whole

    def _once(self, score: _Score, command: MacroCommand, speed: float) -> Generator[float, None, float]:
        if command.type == MACRO:
            yield 0.0
            return (yield from self._play(score, command.command_id, speed))
        if command.type == DELAY:
            duration = command.command_id / 1000 / speed
        else:
            steps = score.actions[command.command_id].steps
            self.move(steps, self._at, speed)
            duration = max((step.interval for step in steps), default=0) * STEP_UNIT / speed
        yield duration
        return duration
