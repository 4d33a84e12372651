"""Dry run of actions and macros without a board: preview of the movements of all servos."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from servolink.errors import ProjectError
from servolink.protocol import ACTION, MACRO, Action, Macro, RecordType, layout
from servolink.virtual.hardware import Hardware
from servolink.virtual.kind import BoardKind
from servolink.virtual.simulated_servo import HIGHEST, LOWEST, SimulatedServo

LONGEST = 600.0
"""Longest dry run, in simulated seconds; a longer run is cut off."""
_MAX_MOVES = 100_000
_MAX_TURNS = 5_000
"""Most turns of a dry run, each with at most 2000 commands, including commands without duration."""
_MEMORY = 2**31 - 1


@dataclass(frozen=True, slots=True)
class DryMove:
    """Movement of one servo; times in seconds since the start, angles in degrees."""

    servo_id: int
    start: float
    end: float
    from_angle: float
    target: int
    """Target angle of the step."""
    is_cut: bool = False
    """Whether a later movement of the same servo interrupts the movement."""


@dataclass(frozen=True, slots=True)
class Timeline:
    """Movements and final angles of a dry run."""

    seconds: float
    moves: tuple[DryMove, ...]
    """Movements in order of start time."""
    angles: dict[int, float]
    """Final angle of each servo, in degrees."""
    is_whole: bool
    """Whether the run is complete, and was not cut off after LONGEST seconds."""


class DryRun:
    """Hardware of a virtual board with given actions and macros; all servos begin at 0 degrees."""

    def __init__(self, actions: Iterable[Action], macros: Iterable[Macro], servo_ids: Iterable[int]) -> None:
        """Store actions and macros. Raise ProjectError for values invalid on every board."""
        self.hardware = Hardware(0, BoardKind(memory=_MEMORY))
        self._moves: list[DryMove] = []
        for servo_id in servo_ids:
            self.hardware.servos[servo_id] = _RecordingServo(servo_id, self._moves.append)
        self._put(ACTION, [Action(one.action_id, "", one.steps) for one in actions])
        self._put(MACRO, [Macro(one.macro_id, "", one.commands) for one in macros])

    def _put(self, record_type: RecordType[Any], records: Sequence[Action | Macro]) -> None:
        codec = self.hardware.codec
        encode = layout(record_type.add_class, codec.byte_order).encode
        contents = {
            record_type.id_of(record): encode(record_type.add(record), codec.caption_encoding) for record in records
        }
        if not self.hardware.storage.put(record_type, contents):
            raise ProjectError(f"the id of one {record_type} is 0, not allowed on any board")

    def begin(self, record: Action | Macro) -> None:
        """Start `record` at the time 0. Raise ProjectError with the reason if `record` cannot be played."""
        self.hardware.advance(0.0)
        if isinstance(record, Action):
            self.hardware.player.run_action(record.action_id, 0.0)
        elif not self.hardware.player.run_macro(record.macro_id, 0.0):
            raise ProjectError(f"cannot be played: {self.hardware.player.why_refused(record.macro_id)}")

    def play(self, record: Action | Macro) -> Timeline:
        """Run `record` to the end, in simulated time. Raise ProjectError as `begin` does."""
        self.begin(record)
        now, turns = 0.0, 0
        while (due := self.hardware.next_due(now)) is not None:
            turns += 1
            if due > LONGEST or turns > _MAX_TURNS or len(self._moves) > _MAX_MOVES:
                break
            now = due
            self.hardware.advance(now)
        is_whole = self.hardware.next_due(now) is None
        if is_whole:
            now = max([now, *(move.end for move in _cut(self._moves))])
            self.hardware.advance(now)
        angles = {servo_id: servo.angle for servo_id, servo in self.hardware.servos.items()}
        return Timeline(now, _cut(self._moves), angles, is_whole)


class _RecordingServo(SimulatedServo):
    """Simulated servo with a record of its movements."""

    def __init__(self, servo_id: int, record: Callable[[DryMove], None]) -> None:
        super().__init__(servo_id, angle=0.0, friction=1.0)
        self._record = record

    def move(self, target: int, duration: float, now: float) -> None:
        self.advance(now)
        self._record(DryMove(self.servo_id, now, now + duration, self.angle, target))
        super().move(target, duration, now)

    def _elapse(self, until: float) -> None:
        """Advance the angle alone: a dry run has neither currents nor temperatures."""
        if self._motion is not None and self._now is not None:
            self.angle = max(LOWEST, min(HIGHEST, self.angle + self._motion.speed * (until - self._now)))
        self._now = until


def _cut(moves: Iterable[DryMove]) -> tuple[DryMove, ...]:
    """Return `moves`, each cut at the start of the next movement of the same servo."""
    ended: list[DryMove] = []
    last: dict[int, int] = {}
    for move in moves:
        before = last.get(move.servo_id)
        if before is not None and ended[before].end > move.start:
            ended[before] = replace(ended[before], end=move.start, is_cut=True)
        last[move.servo_id] = len(ended)
        ended.append(move)
    return tuple(ended)
