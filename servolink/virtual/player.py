"""Player of stored actions and macros."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from typing import TypeVar

from msgspec import Struct

from servolink.protocol import (
    ACTION,
    MACRO,
    Action,
    Codec,
    Macro,
    MacroCommandType,
    MacroPlaying,
    Packet,
    RecordType,
    Step,
)
from servolink.virtual.kind import INTERVAL_UNIT
from servolink.virtual.simulated_servo import SimulatedServo
from servolink.virtual.storage import Storage

# A macro can have billions of commands without duration, and its host can sleep for hours while the macro runs. After
# this much work in one call the macro continues a little later, and is late from then on.
_WORK_AT_ONCE = 2000
_BREAK = 0.01

_TOO_DEEP = (
    f"macros are nested more than {Macro.MAX_NESTING} levels deep, the limit of a virtual board; "
    "other boards may differ"
)

T = TypeVar("T", bound=Struct)


def is_playable(request: Packet) -> bool:
    """Return whether all values of a record are allowed, without negative delays in a macro.

    A record left by an interrupted write may have any values.
    """
    commands = request.commands if isinstance(request, Macro) else ()
    return request.is_in_range() and all(
        command.type != MacroCommandType.DELAY or command.command_id >= 0 for command in commands
    )


class _Unplayable(Exception):
    """Error with the reason why a macro cannot be played."""


class _Snapshot(Struct):
    """Records needed by a macro, copied at the start: later edits do not affect a running macro."""

    actions: dict[int, Action] = {}
    macros: dict[int, Macro] = {}
    heights: dict[int, int] = {}


class Player:
    """Player of stored records: actions start immediately, and only one macro runs at a time."""

    def __init__(
        self, servos: Mapping[int, SimulatedServo], storage: Storage, codec: Codec, interval_unit: float = INTERVAL_UNIT
    ) -> None:
        """Move `servos` according to the records in `storage`; `interval_unit` is in seconds."""
        self._servos = servos
        self._storage = storage
        self._codec = codec
        self._slowness = interval_unit / INTERVAL_UNIT  # exactly 1 for a board that follows the document
        self._running: Generator[float, None, float] | None = None
        self._continue_at = 0.0
        self._next_macro = 0
        self._work_time = 0.0
        self._work = 0  # number of commands and steps done at `_work_time`
        self.macro_id = 0
        """Id of the running macro, 0 without a running macro."""

    @property
    def due(self) -> float | None:
        """Time at which the running macro continues; None without a running macro."""
        return None if self._running is None else self._continue_at

    def move(self, steps: tuple[Step, ...], now: float, speed: float = 1.0) -> None:
        """Start all `steps` together; steps of missing servos have no effect."""
        for step in steps:
            if (servo := self._servos.get(step.servo_id)) is not None:
                servo.move(step.degree, step.seconds * self._slowness / speed, now)
        self._work += len(steps)

    def run_action(self, action_id: int, now: float) -> None:
        """Run a stored action. No effect for a missing or unplayable action."""
        if (action := self._record(ACTION, action_id)) is not None:
            self.move(action.steps, now)

    def run_macro(self, macro_id: int, now: float) -> bool:
        """Run a stored macro, in place of a running macro.

        Return False, without any effect, if the macro or a record needed by the macro is missing or unplayable, or if
        the macro runs itself or is nested too deep.
        """
        snapshot = _Snapshot()
        if self._refusal(macro_id, snapshot):
            return False
        playing = MacroPlaying(snapshot.actions, snapshot.macros, self._move_now, self._slowness)
        self._running = playing.play(macro_id)
        self.macro_id, self._next_macro, self._continue_at = macro_id, 0, now
        return True

    def why_refused(self, macro_id: int) -> str:
        """Return the reason why `run_macro` would return False; empty for a playable macro."""
        return self._refusal(macro_id, _Snapshot())

    def run_after(self, macro_id: int) -> None:
        """Run a stored macro after the end of the running macro."""
        self._next_macro = macro_id

    def stop(self) -> None:
        """End the running macro, and cancel the next macro; moving servos finish their movements."""
        self._running, self.macro_id, self._next_macro = None, 0, 0

    def advance(self, until: float, now: float) -> None:
        """Continue the macro up to the time `until`, at most `now`."""
        if now != self._work_time:
            self._work_time, self._work = now, 0
        while self._running is not None and self._continue_at <= until:
            if self._work >= _WORK_AT_ONCE:
                self._continue_at = now + _BREAK
                return
            self._work += 1
            try:
                self._continue_at += next(self._running)
            except StopIteration:
                self._end()

    def _move_now(self, steps: tuple[Step, ...], speed: float) -> None:
        self.move(steps, self._continue_at, speed)

    def _end(self) -> None:
        following, at = self._next_macro, self._continue_at
        self.stop()
        if following:
            self.run_macro(following, at)

    def _record(self, record_type: RecordType[T], record_id: int) -> T | None:
        request = self._storage.decode(record_type, record_id, self._codec)
        return record_type.record_in(request) if request is not None and is_playable(request) else None

    def _refusal(self, macro_id: int, snapshot: _Snapshot) -> str:
        """Add a macro and all needed records to `snapshot`; return the reason for a failure, empty for success."""
        try:
            self._collect(macro_id, snapshot, above=0)
        except _Unplayable as why:
            return str(why)
        return ""

    def _collect(self, macro_id: int, snapshot: _Snapshot, above: int) -> int:
        """Add a macro and all needed records to `snapshot`; return the depth of nesting, including the macro.

        `above` is the number of macros above. Depths are stored: a macro run by many others may lie deep below only
        some of these, and collecting the macro again for each would take exponential time.
        """
        if (height := snapshot.heights.get(macro_id)) is None:
            if macro_id in snapshot.macros:  # the macro is being collected: a circle
                raise _Unplayable(f"macro {macro_id} runs itself")
            if above >= Macro.MAX_NESTING:
                raise _Unplayable(_TOO_DEEP)
            if (macro := self._record(MACRO, macro_id)) is None:
                raise _Unplayable(f"macro {macro_id} is missing, or has unplayable values")
            snapshot.macros[macro_id] = macro
            height = 1
            for command in macro.commands:
                if command.type == MacroCommandType.MACRO:
                    height = max(height, 1 + self._collect(command.command_id, snapshot, above + 1))
                elif command.type == MacroCommandType.ACTION:
                    self._collect_action(command.command_id, snapshot)
            snapshot.heights[macro_id] = height
        if above + height > Macro.MAX_NESTING:
            raise _Unplayable(_TOO_DEEP)
        return height

    def _collect_action(self, action_id: int, snapshot: _Snapshot) -> None:
        if action_id not in snapshot.actions:
            if (action := self._record(ACTION, action_id)) is None:
                raise _Unplayable(f"action {action_id} is missing, or has unplayable values")
            snapshot.actions[action_id] = action
