"""Physics with known answers, and the clock that board and body share.

Module: servolink.twin.simulation.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from servolink.twin.body import GRAVITY, Body
from servolink.twin.simulation import Physics, Simulation, mujoco
from servolink.virtual import Hardware
from tests.twin.figures import LIMB, arm, body, box, template

FREE = {"torque": 0.001, "speed": 10_000}
"""Servo without noticeable friction."""
HUMANOID = Body.of(template("humanoid-16"))


def lean(physics: Physics, part: str) -> float:
    """Return the angle in degrees by which a part leans."""
    return math.degrees(math.acos(min(1.0, float(physics.data.body(part).xmat[8]))))


def test_a_pendulum_has_its_period() -> None:
    physics = Physics(arm(**FREE), step=0.001)
    physics.release(0, released=True)
    physics.data.qpos[0] = math.radians(4)
    crossings = list[float]()
    while len(crossings) < 3:
        before = float(physics.data.qpos[0])
        physics.advance(1)
        if before > 0 >= physics.data.qpos[0]:
            crossings.append(physics.data.time)
    inertia = 0.4 * ((0.2**2 + 0.02**2) / 12 + 0.1**2)
    expected = 2 * math.pi * math.sqrt(inertia / (0.4 * GRAVITY * 0.1))
    assert (crossings[2] - crossings[0]) / 2 == pytest.approx(expected, rel=0.003)


@pytest.mark.parametrize(("short_of", "stands"), [(0.8, True), (-0.8, False)])
def test_a_box_tips_at_its_angle(short_of: float, stands: bool) -> None:
    physics = Physics(box())
    angle = math.atan(40 / 100) - math.radians(short_of)
    physics.model.opt.gravity[:] = (GRAVITY * math.sin(angle), 0, -GRAVITY * math.cos(angle))
    physics.advance(1500)
    assert (lean(physics, "box") < 2) == stands


def test_a_held_arm_takes_its_static_torque_and_sags_by_it() -> None:
    physics = Physics(arm(degrees=90, torque=2, stiffness=0.2))
    physics.advance(2000)
    sag = math.degrees(physics.data.qpos[0])
    torque = 0.4 * GRAVITY * 0.1 * math.cos(math.radians(sag))
    assert abs(physics.data.actuator_force[0]) == pytest.approx(torque, rel=0.01)
    assert abs(sag) == pytest.approx(torque / 0.2, rel=0.01)


def test_a_servo_turns_no_faster_than_its_speed() -> None:
    physics = Physics(arm(torque=5, speed=100))
    physics.model.opt.gravity[:] = 0
    physics.data.ctrl[0] = math.pi / 2
    fastest = 0.0
    for _ in range(400):
        physics.advance(1)
        fastest = max(fastest, float(physics.data.qvel[0]))
    assert 70 < math.degrees(fastest) < 101


def test_a_double_pendulum_keeps_its_energy() -> None:
    lower = {"id": "lower", "parent": "upper", "servo": 2, "at": [0, -200, 0], "shapes": [LIMB], **FREE}
    upper = {"id": "upper", "servo": 1, "shapes": [LIMB], **FREE}
    physics = Physics(body(upper, lower, base={"mode": "fixed", "at": [0, 900, 0]}), step=0.0005)
    physics.model.opt.enableflags |= int(mujoco().mjtEnableBit.mjENBL_ENERGY)
    for at in (0, 1):
        physics.release(at, released=True)
    physics.data.qpos[:] = (1.2, 0.6)
    physics.advance(1)
    start, fastest = float(physics.data.energy.sum()), 0.0
    for _ in range(40):
        physics.advance(100)
        fastest = max(fastest, float(physics.data.energy[1]))
        assert abs(physics.data.energy.sum() - start) < 0.02 * fastest
    assert fastest > 0.1, "joules"


def test_the_humanoid_stands_with_all_servos_at_0() -> None:
    physics = Physics(HUMANOID)
    physics.advance(2500)
    assert max(lean(physics, foot) for foot in HUMANOID.feet) < 0.5
    assert physics.touching() == {("floor", "l_foot"), ("floor", "r_foot")}


def bowed(degrees: int) -> Physics:
    """Return the humanoid two seconds after a bow by `degrees` in 1.5 s."""
    simulation = Simulation(Physics(HUMANOID), Hardware(16))
    for servo_id, sign in ((8, 1), (13, -1)):
        simulation.hardware.servos[servo_id].move(sign * degrees, 1.5, 0.0)
    simulation.advance(3.5)
    return simulation.physics


def test_a_bow_that_leaves_the_sole_falls() -> None:
    assert max(lean(bowed(10), foot) for foot in HUMANOID.feet) < 1
    assert min(lean(bowed(80), foot) for foot in HUMANOID.feet) > 30


def test_the_same_run_ends_in_the_same_state() -> None:
    one, other = (bowed(40).data.qpos for _ in range(2))
    assert np.array_equal(one, other)


@pytest.mark.parametrize("step", [0.001, 0.002, 0.005])
def test_body_and_board_share_a_clock(step: float) -> None:
    simulation = Simulation(Physics(arm(), step), Hardware(1))
    simulation.hardware.servos[1].move(30, 0.5, 0.0)
    simulation.advance(0.25)
    assert simulation.now == pytest.approx(0.25)
    assert simulation.physics.data.time == pytest.approx(0.25)
    assert simulation.hardware.servos[1].angle == pytest.approx(15, abs=1)
    assert 5 < simulation.physics.angle(0) < 14, "the arm lags behind"
    simulation.advance(1)
    assert simulation.physics.angle(0) == pytest.approx(30, abs=3)


def test_a_released_servo_hangs_and_its_board_knows_where() -> None:
    simulation = Simulation(Physics(arm(degrees=90, torque=2)), Hardware(1))
    servo = simulation.hardware.servos[1]
    simulation.advance(0.5)
    servo.set_flags(1, 0, simulation.now)
    simulation.advance(4)
    assert simulation.physics.angle(0) == pytest.approx(90, abs=10), "it hangs down"
    assert servo.angle == pytest.approx(simulation.physics.angle(0), abs=1)
    servo.set_flags(1, 1, simulation.now)
    servo.move(0, 0.5, simulation.now)
    simulation.advance(6)
    assert simulation.physics.angle(0) == pytest.approx(0, abs=15)


def test_warnings_of_mujoco_are_neither_printed_nor_written_to_a_file() -> None:
    Physics(box())
    assert mujoco().get_mju_user_warning() is not None


def test_parts_beside_a_joint_of_a_bolted_base_may_overlap() -> None:
    plate, pin = {"id": "plate", "shapes": [{"box": [100, 20, 100]}]}, {"id": "pin", "parent": "plate", "length": 10}
    limb = {"id": "limb", "parent": "pin", "servo": 1, "at": [0, 10, 0], "length": 200, "along": [0, 1, 0]}
    hand = {"id": "hand", "parent": "limb", "servo": 2, "at": [0, 30, 0], "length": 60, "along": [0, 1, 0]}
    physics = Physics(body(plate, pin, limb, hand, body={"bolted": True, "touching": [["hand", "pin"]]}))
    physics.pose({1: 60})
    assert physics.touching() == set()
    physics.pose({1: 60, 2: 120})
    assert ("hand", "plate") in physics.touching(), "there is a joint between"
