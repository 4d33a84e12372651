"""Courses: angles that servos should have by now, from the movements sent to them. No clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from servolink.motion import AngleUnit, ServoWay
from servolink.protocol import (
    ALL_SERVOS,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Packet,
    SetServoParameterRequest,
)


class Courses:
    """Movements of servos, as far as the hub knows: it has sent them, and nothing else has turned the servo since.

    Times are in seconds of any clock that does not jump.
    """

    def __init__(self) -> None:
        self.changes = 0
        """Number of changes so far: by what was sent, and by what was forgotten."""
        self._ways: dict[int, ServoWay] = {}
        self._run_ends = -math.inf  # time at which the latest stored run is over

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
            case ExecuteActionRequest():
                self._ways.clear()
            case _:
                self.forget()
                if isinstance(packet, ExecuteActionExRequest | ExecuteMacroRequest):
                    self._run_ends = math.inf

    def forget(self) -> None:
        """Forget all movements: the servos were stopped, or something else may have turned them."""
        self.changes += 1
        self._ways.clear()
        self._run_ends = -math.inf

    def end(self, pose: Mapping[int, int], at: float, unit_of: Callable[[int], AngleUnit | None]) -> None:
        """Take the last targets of a stored record, by servo id, which it reaches at a time."""
        self._run_ends = at
        degrees = {servo_id: target for servo_id, target in pose.items() if unit_of(servo_id) == "degree"}
        self._ways |= {servo_id: ServoWay(target, target, at, 0.0) for servo_id, target in degrees.items()}

    def lag(self, servo_id: int, angle: int, now: float) -> int | None:
        """Return by how many degrees a servo at `angle` is away from its course; None without a known course."""
        way = self._ways.get(servo_id)
        return None if way is None or now < way.began else abs(round(way.at(now)) - angle)

    def _turn(self, servo_id: int, target: int, now: float, seconds: float, unit: AngleUnit | None) -> None:
        """Keep the way of a servo to `target`; without a known start, its course is known from the end on."""
        before = self._ways.pop(servo_id, None)
        if unit != "degree":
            return
        if before is None or now < before.began:
            self._ways[servo_id] = ServoWay(target, target, now + seconds, 0.0)
        else:
            self._ways[servo_id] = ServoWay(before.at(now), target, now, seconds)
