"""Which steps of a macro start when, for whoever plays it: a virtual board, or a program that moves a real one."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass

from servolink.protocol.records import Action, Macro, MacroCommand, MacroCommandType, Step

MAX_NESTING = 32
"""How deep macros may run macros, itself included, on virtual boards and where a program follows what a macro runs.

The document has no such limit.
"""


@dataclass(frozen=True, slots=True)
class MacroPlaying:
    """Plays macros without a clock: what moves is passed to `move`, and each pause is yielded in seconds.

    All steps of an action start together, and it takes as long as its longest step. A ratio of 50 makes a command twice
    as long, its delays too. A command takes its `total_interval`, or longer if what it runs does.
    """

    actions: Mapping[int, Action]
    macros: Mapping[int, Macro]
    move: Callable[[tuple[Step, ...], float], None]
    """Takes the steps that start now, and their speed: at 0.5 each takes twice its interval."""
    slowness: float = 1.0
    """How many times longer than in the document an interval is on the board."""

    def play(self, macro_id: int, speed: float = 1.0) -> Generator[float, None, float]:
        """Run a macro, yielding each time to wait; return the time it took.

        Every record that it needs must be there, no macro may run itself, and no ratio may be 0.
        """
        total = 0.0
        for command in self.macros[macro_id].commands:
            yield 0.0
            elapsed = 0.0
            for _ in range(command.loop):
                elapsed += yield from self._play_once(command, speed * command.ratio / 100)
            rest = command.total_interval / 1000 / speed - elapsed
            if rest > 0:
                yield rest
            total += max(rest, 0.0) + elapsed
        return total

    def _play_once(self, command: MacroCommand, speed: float) -> Generator[float, None, float]:
        if command.type == MacroCommandType.MACRO:
            yield 0.0  # so that nested loops without any time are work, too, and interrupted after enough of it
            return (yield from self.play(command.command_id, speed))
        if command.type == MacroCommandType.DELAY:
            duration = command.command_id / 1000 / speed
        else:
            action = self.actions[command.command_id]
            self.move(action.steps, speed)
            duration = action.seconds * self.slowness / speed
        yield duration
        return duration
