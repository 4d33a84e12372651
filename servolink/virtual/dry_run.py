"""Actions and macros played on a virtual board, to see who moves when before anything real does."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from servolink.errors import ProjectError
from servolink.protocol.editing import AddActionRequest, AddMacroRequest
from servolink.protocol.frame import HEADER_SIZE
from servolink.protocol.records import Action, Macro
from servolink.virtual.hardware import Hardware
from servolink.virtual.servo import Servo
from servolink.virtual.storage import Kind

LONGEST = 600.0
"""Seconds after which a play ends that has not ended by itself."""
_MOST_MOVES = 100_000
_MOST_TURNS = 5_000
"""In each of them a board does 2000 commands at most, those that take no time among them."""
_MEMORY = 2**31 - 1


@dataclass(frozen=True, slots=True)
class Move:
    """One servo on its way; seconds since the start, angles in degrees."""

    servo_id: int
    start: float
    end: float
    from_angle: float
    target: int
    """What the step asks for."""
    is_cut: bool = False
    """Another move came before this one had ended."""


@dataclass(frozen=True, slots=True)
class Timeline:
    """What was played."""

    seconds: float
    moves: tuple[Move, ...]
    """In the order in which they began."""
    angles: dict[int, float]
    """Where each servo is at the end."""
    is_whole: bool
    """Not so if it was cut off, because it is endless or nearly so."""


class DryRun:
    """A virtual board with these actions and macros, whose servos all begin at 0 degrees."""

    def __init__(self, actions: Iterable[Action], macros: Iterable[Macro], servo_ids: Iterable[int]) -> None:
        """Store everything; ProjectError for values that no board takes."""
        self.hardware = Hardware(0, memory=_MEMORY)
        self._moves: list[Move] = []
        for servo_id in servo_ids:
            self.hardware.servos[servo_id] = _NotedServo(servo_id, self._moves.append)
        self._put(Kind.ACTION, [AddActionRequest(one.action_id, "", one.steps) for one in actions])
        self._put(Kind.MACRO, [AddMacroRequest(one.macro_id, "", one.commands) for one in macros])

    def _put(self, kind: Kind, requests: list[AddActionRequest] | list[AddMacroRequest]) -> None:
        contents = {
            getattr(request, request.__struct_fields__[0]): self.hardware.codec.encode(request)[HEADER_SIZE:-1]
            for request in requests
        }
        if not self.hardware.storage.put(kind, contents):
            raise ProjectError(f"a board takes no {kind} with the id 0")

    def begin(self, record: Action | Macro) -> None:
        """Run `record` at the time 0; ProjectError if it, or what it needs, is missing or runs itself."""
        self.hardware.advance(0.0)
        if isinstance(record, Action):
            self.hardware.player.run_action(record.action_id, 0.0)
        elif not self.hardware.player.run_macro(record.macro_id, 0.0):
            raise ProjectError("it cannot be played: something that it calls is missing, or it runs itself")

    def play(self, record: Action | Macro) -> Timeline:
        """Run `record` to its end, at once; ProjectError as for `begin`."""
        self.begin(record)
        now, turns = 0.0, 0
        while (due := self.hardware.next_due(now)) is not None:
            turns += 1
            if due > LONGEST or turns > _MOST_TURNS or len(self._moves) > _MOST_MOVES:
                break
            now = due
            self.hardware.advance(now)
        is_whole = self.hardware.next_due(now) is None
        if is_whole:
            now = max([now, *(move.end for move in _cut(self._moves))])
            self.hardware.advance(now)
        angles = {servo_id: servo.angle for servo_id, servo in self.hardware.servos.items()}
        return Timeline(now, _cut(self._moves), angles, is_whole)


class _NotedServo(Servo):
    """A servo that tells how it is moved."""

    def __init__(self, servo_id: int, note: Callable[[Move], None]) -> None:
        super().__init__(servo_id, angle=0.0, friction=1.0)
        self._note = note

    def move(self, target: int, duration: float, now: float) -> None:
        self.advance(now)
        self._note(Move(self.servo_id, now, now + duration, self.angle, target))
        super().move(target, duration, now)


def _cut(moves: Iterable[Move]) -> tuple[Move, ...]:
    """Return `moves`, each ended where the next one of the same servo begins."""
    ended: list[Move] = []
    last: dict[int, int] = {}
    for move in moves:
        before = last.get(move.servo_id)
        if before is not None and ended[before].end > move.start:
            ended[before] = replace(ended[before], end=move.start, is_cut=True)
        last[move.servo_id] = len(ended)
        ended.append(move)
    return tuple(ended)
