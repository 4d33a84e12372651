"""Courses: angles that servos should have by now, from the movements sent to them. No clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from typing import TypeAlias

from servolink.motion import AngleUnit, ServoWay
from servolink.protocol import (
    ALL_SERVOS,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Packet,
    SetServoParameterRequest,
    Step,
)

_FRESH = 3.0  # seconds for which a reading says where a servo is that nothing has moved since
_WORK = 1000  # steps of a stored run that are followed at once; a run with more is not followed


Play: TypeAlias = Callable[[Callable[[tuple[Step, ...], float], None]], Generator[float, None, object]]
"""Plays a stored record without a clock: passes steps and speed on, and yields each pause in seconds."""


class Courses:
    """Movements of servos, as far as the hub knows: it has sent them, and nothing else has turned the servo since.

    Times are in seconds of any clock that does not jump.
    """

    def __init__(self) -> None:
        self.changes = 0
        """Number of changes so far: by what was sent, and by what was forgotten."""
        self._ways: dict[int, ServoWay] = {}
        self._seen: dict[int, ServoWay] = {}  # by the latest reading, for servos without a known course
        self._is_seen = False  # whether no course was lost since that reading
        self._run_ends = -math.inf  # time at which the latest stored run is over
        self._run: Generator[float, None, object] | None = None  # steps of the stored run, up to `_run_at`
        self._run_at = 0.0

    def sent(
        self, packet: Packet, now: float, unit_of: Callable[[int], AngleUnit | None], interval_unit: float
    ) -> None:
        """Take a motion sent at `now`; an interval of 1 stands for `interval_unit` seconds.

        While a stored record runs, nobody knows its steps, and a movement beside it may be overtaken by one of them.
        """
        self.changes += 1
        match packet:
            case ExecuteActionRequest() if now >= self._run_ends:
                for step in packet.steps:
                    self._turn(step.servo_id, step.degree, now, step.interval * interval_unit, unit_of(step.servo_id))
            case SetServoParameterRequest() if packet.servo_id != ALL_SERVOS:
                self._ways.pop(packet.servo_id, None)
                self._is_seen = False
            case ExecuteActionRequest():
                self._ways.clear()
                self._is_seen = False
            case _:
                self.forget()
                if isinstance(packet, ExecuteActionExRequest | ExecuteMacroRequest):
                    self._run_ends = math.inf

    def forget(self) -> None:
        """Forget all movements: the servos were stopped, or something else may have turned them."""
        self.changes += 1
        self._ways.clear()
        self._is_seen = False
        self._run_ends, self._run = -math.inf, None

    def end(self, pose: Mapping[int, int], at: float, unit_of: Callable[[int], AngleUnit | None]) -> None:
        """Take the last targets of a stored record, by servo id, which it reaches at a time."""
        self._run_ends = at
        degrees = {servo_id: target for servo_id, target in pose.items() if unit_of(servo_id) == "degree"}
        self._ways |= {servo_id: ServoWay(target, target, at, 0.0) for servo_id, target in degrees.items()}

    def seen(self, angles: Mapping[int, int], now: float) -> None:
        """Take a reading: servos without a known course begin their next movement where they are, degrees by id."""
        self._is_seen = True
        self._seen = {servo_id: ServoWay(angle, angle, now, 0.0) for servo_id, angle in angles.items()}

    def play(self, run: Play, began: float, unit_of: Callable[[int], AngleUnit | None], interval_unit: float) -> None:
        """Take the steps of a stored record that began at a time, for `follow`."""

        def move(steps: tuple[Step, ...], speed: float) -> None:
            for step in steps:
                seconds = step.interval * interval_unit / speed
                self._turn(step.servo_id, step.degree, self._run_at, seconds, unit_of(step.servo_id))

        self._run, self._run_at = run(move), began

    def follow(self, now: float) -> None:
        """Learn the courses of the stored record that runs, up to the present."""
        if self._run is not None:
            # Of the run, until now only the end was known.
            self._ways = {each: way for each, way in self._ways.items() if way.began <= now}
        work = 0
        while self._run is not None and self._run_at <= now:
            work += 1
            try:
                self._run_at += next(self._run)
            except (StopIteration, LookupError, ArithmeticError):  # over, or boards differ in what they make of it
                self._run = None
            if work > _WORK:
                self._run = None

    def way(self, servo_id: int) -> ServoWay | None:
        """Return the latest movement of a servo; None without a known course."""
        return self._ways.get(servo_id)

    def pose(self, now: float) -> dict[int, float]:
        """Return where servos should be, in degrees by id: by their course, or by a fresh reading.

        While a stored record runs whose steps are not followed, nobody knows.
        """
        if not self._is_seen or (now < self._run_ends and self._run is None):
            return {}
        known = {each: float(seen.target) for each, seen in self._seen.items() if now - seen.began <= _FRESH}
        return known | {each: way.at(now) for each, way in self._ways.items() if way.began <= now}

    def end_of_motion(self) -> float:
        """Return the time at which all motions that the hub knows are over, infinite if that is unknown."""
        return max(self._run_ends, *(way.began + way.seconds for way in self._ways.values()), -math.inf)

    def lag(self, servo_id: int, angle: int, now: float) -> int | None:
        """Return by how many degrees a servo at `angle` is away from its course; None without a known course."""
        way = self._ways.get(servo_id)
        return None if way is None or now < way.began else abs(round(way.at(now)) - angle)

    def _turn(self, servo_id: int, target: int, now: float, seconds: float, unit: AngleUnit | None) -> None:
        """Keep the way of a servo to `target`; without a known start, its course is known from the end on."""
        before = self._ways.pop(servo_id, None)
        if before is None and (seen := self._seen.get(servo_id)) is not None and now - seen.began <= _FRESH:
            before = seen
        if unit != "degree":
            return
        if before is None or now < before.began:
            self._ways[servo_id] = ServoWay(target, target, now + seconds, 0.0)
        else:
            self._ways[servo_id] = ServoWay(before.at(now), target, now, seconds)
