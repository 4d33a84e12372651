"""Courses: angles that servos should have by now, from the movements sent to them. No clock."""

from __future__ import annotations

from collections.abc import Callable

from servolink.motion.angles import AngleUnit
from servolink.motion.set_points import ServoWay
from servolink.protocol.packet import Packet
from servolink.protocol.servos import ALL_SERVOS, ExecuteActionRequest, SetServoParameterRequest


class Courses:
    """Movements of servos, as far as the hub knows: it has sent them, and nothing else has turned the servo since.

    Times are in seconds of any clock that does not jump.
    """

    def __init__(self) -> None:
        self._ways: dict[int, ServoWay] = {}

    def sent(
        self, packet: Packet, now: float, unit_of: Callable[[int], AngleUnit | None], interval_unit: float
    ) -> None:
        """Take a motion sent at `now`; an interval of 1 stands for `interval_unit` seconds.

        What a stored record turns, and what a started servo does, is unknown.
        """
        match packet:
            case ExecuteActionRequest():
                for step in packet.steps:
                    self._turn(step.servo_id, step.degree, now, step.interval * interval_unit, unit_of(step.servo_id))
            case SetServoParameterRequest() if packet.servo_id != ALL_SERVOS:
                self._ways.pop(packet.servo_id, None)
            case _:
                self.forget()

    def forget(self) -> None:
        """Forget all movements: the servos were stopped, or something else may have turned them."""
        self._ways.clear()

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
