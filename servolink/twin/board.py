"""Virtual board with a body: its servos sag, lag, stall, and fall with the robot."""

from __future__ import annotations

import math
import os
from typing import Final

from servolink.protocol import Codec
from servolink.twin.body import Body
from servolink.twin.simulation import Physics, Simulation
from servolink.virtual import BoardKind, SimulatedServo, VirtualBoard

LATEST: Final = 0.1
"""Seconds by which the body may be late: on a machine that is too slow, or was asleep, the body loses time."""


def read_board(
    path: str | os.PathLike[str],
    *,
    servos: int | None = None,
    seed: int = 0,
    codec: Codec | None = None,
    kind: BoardKind = BoardKind.DEFAULT,
) -> TwinBoard:
    """Return a board with the body of a project.

    Raises:
        ProjectError: The file cannot be read.
        TwinError: The figure has no possible body, or MuJoCo is missing.
    """
    return TwinBoard(Body.read(path)[1], servos, seed, codec, kind)


class TwinBoard(VirtualBoard):
    """Virtual board whose servos turn the parts of a body; all else is as on any virtual board.

    Motions begin at the angle commanded last, as the board does not know how far a servo lags. A released servo turns
    with the part, and its angle is known.
    """

    def __init__(
        self,
        body: Body,
        servos: int | None = None,
        seed: int = 0,
        codec: Codec | None = None,
        kind: BoardKind = BoardKind.DEFAULT,
    ) -> None:
        """Put the body at rest. The number of servos is by default the highest servo id of the body.

        Raises:
            TwinError: Parts of the body overlap, or MuJoCo is missing.
            ValueError: A value is out of range.
        """
        super().__init__(max(body.drives, default=0) if servos is None else servos, seed, codec, kind)
        self.physics = Physics(body)
        for at, servo_id in enumerate(self.physics.servo_ids):
            if servo_id in self.servos:
                self.servos[servo_id] = BodyServo(servo_id, self.physics, at)
        self._simulation = Simulation(self.physics, self)
        self._start: float | None = None

    def advance(self, now: float) -> None:
        """Advance the board to the time `now`, and the body by all ticks due."""
        if self._start is None:
            self._start = now
        self._start = max(self._start, now - LATEST - self._simulation.now)
        while (due := self._start + self._simulation.now) <= now:
            super().advance(due)
            self._simulation.turn()
        super().advance(now)

    def next_due(self, now: float) -> float | None:
        """Return the time for the next call of `advance`, at least `now`; a body always moves on."""
        due = super().next_due(now)
        tick = now if self._start is None else max(now, self._start + self._simulation.now)
        return tick if due is None else min(due, tick)

    def push_servo(self, servo_id: int, degree: float, now: float) -> None:
        """Turn a servo and its part by hand to an angle in degrees. No effect for a held or missing servo."""
        super().push_servo(servo_id, degree, now)
        servo = self.servos.get(servo_id)
        if isinstance(servo, BodyServo) and not servo.is_hold:
            servo.turn_part()


class BodyServo(SimulatedServo):
    """Servo of a body: `angle` is the command, which the body follows as well as its torque allows."""

    def __init__(self, servo_id: int, physics: Physics, at: int) -> None:
        """Turn the part of the servo at a place of `physics.servo_ids`."""
        super().__init__(servo_id, angle=0.0, friction=1.0)
        self._physics = physics
        self._at = at
        self._joint = physics.positions[at]
        self._strongest = float(physics.model.actuator_forcerange[at, 1])
        self._range = physics.model.jnt_range[physics.model.actuator_trnid[at, 0]]

    @property
    def position(self) -> float:
        """Angle of the part, in degrees."""
        return math.degrees(self._physics.data.qpos[self._joint])

    @property
    def current(self) -> float:
        """Present current of the servo, raw ADC: a motor draws current in proportion to its torque."""
        share = min(1.0, abs(float(self._physics.data.actuator_force[self._at])) / self._strongest)
        return self.IDLE_CURRENT + (self.MAX_CURRENT - self.IDLE_CURRENT) * share

    def turn_part(self) -> None:
        """Turn the part to the angle of the servo, up to the limits of the joint."""
        self._physics.data.qpos[self._joint] = min(max(math.radians(self.angle), self._range[0]), self._range[1])
