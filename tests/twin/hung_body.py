"""A body that hangs free, each of its servos turned by a servo of a board."""

from __future__ import annotations

from itertools import combinations

from msgspec.structs import replace

from servolink.project import BodyFields
from servolink.twin.board import BodyServo
from servolink.twin.body import Body
from servolink.twin.simulation import Physics, Simulation
from servolink.virtual import Hardware
from tests.twin.figures import template

_STEP = 0.005


class HungBody:
    """Body of a figure of the studio, held at its base, in which no part is in the way of another."""

    def __init__(self, name: str, seed: int) -> None:
        figure = template(name)
        touching = tuple(combinations((joint.id for joint in figure.joints), 2))
        body = replace(figure.body or BodyFields(), bolted=True, touching=touching)
        self.physics = Physics(Body.of(replace(figure, body=body)), _STEP)
        self.physics.model.geom_contype[:] = self.physics.model.geom_conaffinity[:] = 0
        hardware = Hardware(max(self.physics.servo_ids), seed=seed)
        self.servos = {
            servo_id: BodyServo(servo_id, self.physics, at) for at, servo_id in enumerate(self.physics.servo_ids)
        }
        hardware.servos.clear()
        hardware.servos.update(self.servos)
        self.simulation = Simulation(self.physics, hardware)
