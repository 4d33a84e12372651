"""Measuring: hidden values of a servo are found from the readings of its movements, or said to be unknown.

Module: servolink.twin.measuring.
"""

from __future__ import annotations

import asyncio
import random
from dataclasses import dataclass
from datetime import date
from typing import Any

import pytest
from msgspec import UNSET
from msgspec.structs import replace

from servolink.client import connect
from servolink.errors import TwinError
from servolink.project import Figure
from servolink.twin import ServoMeasuring, read_urdf, to_urdf
from servolink.twin.board import TwinBoard
from servolink.twin.body import Body
from servolink.twin.measuring import MeasuredServo
from servolink.twin.mjcf import model_text
from servolink.virtual import VirtualTransport
from tests.twin.figures import LIMB, figure

DAY = date(2026, 11, 30)
GRAVITY = 0.4 * 9.81 * 0.1
"""Torque in N m that holds the limb of these tests level."""


def limb(degrees: float = 0, **more: Any) -> Figure:
    """Return the figure of `figures.arm`: a limb of 0.4 kg, raised by some degrees with servo 1 at 0."""
    joint = {"id": "arm", "servo": 1, "shapes": [LIMB], "mass": 0.4, "axis": "x", "offset": -degrees, **more}
    return figure(joint, base={"mode": "fixed", "at": [0, 500, 0]})


@dataclass
class Hidden:
    """Servo of a virtual board, of which its figure says nothing."""

    speed: float
    lag: float
    torque: float
    phase: float = 0.0

    @classmethod
    def of(cls, seed: int, *, heaviness: float = 0.0) -> Hidden:
        """Return values by a seed; `heaviness` is the torque of gravity as a share of that of the servo, 0 for any."""
        chance = random.Random(seed)
        speed, lag, share = chance.uniform(180, 450), chance.uniform(3.5, 8), chance.uniform(0.1, 0.3)
        return cls(speed, lag, GRAVITY / (heaviness or share), chance.random() * 0.01)

    def board(self, degrees: float) -> TwinBoard:
        stiffness = self.torque / self.lag
        return TwinBoard(Body.of(limb(degrees, speed=self.speed, torque=self.torque, stiffness=stiffness)))

    async def measured(self, movements: int, degrees: float = 0) -> MeasuredServo:
        """Move a virtual board, read it as `twin measure` does, and return what the readings say."""
        measuring, now = ServoMeasuring(limb(degrees), 1), asyncio.get_running_loop().time
        async with connect(VirtualTransport(self.board(degrees))) as board:
            at = 0
            for number in range(movements):
                for goal, seconds in measuring.movement(number, 0, -180, 180):
                    await asyncio.sleep(0.5 + self.phase * number)
                    readings = []
                    async with board.watch(100) as watched:
                        await board.move({1: goal}, duration=seconds)
                        begun = now()
                        while now() < begun + seconds + 0.5:
                            one = await anext(watched)
                            readings.append((one.seconds - begun, float(one.servos[0].angle)))
                    measuring.add({1: float(at)}, goal, seconds, [one for one in readings if one[0] > 0])
                    at = goal
        return measuring.result(movements, DAY)

    def off(self, found: MeasuredServo, name: str) -> float:
        """Return the difference to the hidden value, as a share of it."""
        return abs(found.found[name][0] / float(getattr(self, name)) - 1)


@pytest.mark.parametrize("seed", [9001, 9002, 9003, 9004])
async def test_speed_and_lag_are_found_within_ten_percent(seed: int) -> None:
    hidden = Hidden.of(seed)
    found = await hidden.measured(12)
    assert {"speed", "lag"} & found.unknown.keys() == set()
    assert hidden.off(found, "speed") < 0.1
    assert hidden.off(found, "lag") < 0.1
    if "torque" not in found.unknown:
        assert hidden.off(found, "torque") < 0.1


@pytest.mark.parametrize("seed", [9101, 9102])
async def test_the_strength_of_a_servo_with_a_heavy_limb_is_found(seed: int) -> None:
    hidden = Hidden.of(seed, heaviness=0.4)
    found = await hidden.measured(12, degrees=60)
    assert "torque" not in found.unknown
    assert hidden.off(found, "torque") < 0.1


async def test_the_strength_of_a_servo_with_a_light_limb_stays_unknown() -> None:
    found = await Hidden(300, 5, 15 * GRAVITY).measured(8)
    assert "so does a limb that is heavy for its servo" in found.unknown["torque"]
    assert found.figure.joints[0].measured.torque is UNSET  # type: ignore[union-attr]
    assert Body.of(found.figure).basis == {
        "weight": "written",
        "strength": "assumed",
        "speed": "measured",
        "lag": "measured",
    }


def test_readings_that_no_servo_gives_are_refused() -> None:
    measuring, chance = ServoMeasuring(limb(), 1), random.Random(1)
    for goal, at in ((30, 0), (0, 30)) * 2:
        way = [(tick / 100, at + (goal - at) * min(1.0, tick / 50)) for tick in range(1, 100)]
        measuring.add({1: float(at)}, goal, 0.5, [(when, angle + chance.uniform(-5, 5)) for when, angle in way])
    with pytest.raises(TwinError, match="do not fit a servo that turns this part of the figure"):
        measuring.result(4, DAY)


def test_a_servo_that_does_not_turn_or_not_arrive_is_not_measured() -> None:
    measuring = ServoMeasuring(limb(), 1)
    with pytest.raises(TwinError, match="servo 1 was told to turn, and reports that it has not"):
        measuring.add({1: 0.0}, 30, 0.5, [(0.1, 0.0), (0.2, 0.0)])
    blocked = [(at / 100, float(min(12, at))) for at in range(1, 80)]
    with pytest.raises(TwinError, match="servo 1 has come to 12° and not to 30°: something is in the way"):
        measuring.add({1: 0.0}, 30, 0.5, blocked)
    with pytest.raises(TwinError, match="servo 2 turns no part of the figure"):
        ServoMeasuring(limb(), 2)


def test_movements_stay_within_all_limits() -> None:
    measuring = ServoMeasuring(limb(limits=[-40, 90]), 1)
    assert [measuring.movement(at, 0, -180, 180)[0][0] for at in range(3)] == [30, -30, 30]
    assert [measuring.movement(at, 0, -20, 180)[0][0] for at in range(2)] == [30, 30]
    assert [goal for goal, _ in measuring.movement(0, 80, -180, 180)] == [50, 80, 50, 80]
    with pytest.raises(TwinError, match=r"servo 1 is at 5° and may turn from -20° to 20°, without room for 30°"):
        measuring.movement(0, 5, -20, 20)


def test_measured_values_replace_written_ones_everywhere(tmp_path: Any) -> None:
    written = limb(torque=1, speed=100, stiffness=0.5)
    ranges = {"speed": (240, 236, 244), "torque": (2, 1.9, 2.1), "lag": (4, 3.8, 4.2)}
    joint = written.joints[0].with_measured(on=DAY.isoformat(), movements=8, **ranges)
    measured = replace(written, joints=(joint,)).checked()
    assert (written.checked().version, measured.version) == (1, 2)
    assert Figure.from_json(measured.to_json()) == measured
    (part, drive) = Body.of(measured).drives[1]
    assert drive.torque == 2
    assert drive.stiffness * 3.14159265 / 180 == pytest.approx(0.5)
    assert 'forcerange="-2 2"' in model_text(Body.of(measured))
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(to_urdf(measured))
    back = read_urdf(urdf)[0]
    assert {(one.torque, one.speed) for one in back.joints if one.servo == 1} == {(2, 240)}, part.name
