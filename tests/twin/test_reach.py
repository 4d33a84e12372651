"""Reach: random places that a limb can reach, places that it cannot, feet that stay, and hostile questions.

Module: servolink.twin.reach.
"""

from __future__ import annotations

import math
from random import Random
from typing import Any

import pytest

from servolink.errors import TwinError
from servolink.twin.body import Body
from servolink.twin.placement import Vector
from servolink.twin.reach import REACHED, PosableFigure, load_figure
from servolink.twin.simulation import Physics, Simulation
from servolink.virtual import Hardware
from tests.twin.figures import DEMO, LIMB, figure, template

HUMANOID = PosableFigure(template("humanoid-16"))
LIMITS = {servo: part.limits for servo, (part, _) in Body.of(template("humanoid-16")).drives.items()}
PENDULUM = {"id": "arm", "servo": 1, "shapes": [LIMB], "tip": [0, -200, 0], "limits": [-60, 100]}
BASE = {"base": {"mode": "fixed", "at": [0, 500, 0]}}


@pytest.mark.parametrize(
    ("part", "servos"),
    [("left hand", range(4, 7)), ("Right arm", range(1, 4)), ("left foot", range(12, 17)), ("右腿", range(7, 12))],
)
def test_random_places_are_reached_within_the_limits(part: str, servos: range) -> None:
    random, reached = Random(5), 0
    for _ in range(25):
        angles = {servo: math.degrees(random.uniform(*LIMITS[servo])) for servo in servos}
        place = HUMANOID.place(part, angles)
        pose = HUMANOID.reach({part: place})
        assert pose.angles.keys() == set(servos), "no other servo turns"
        assert all(
            LIMITS[servo][0] - 1e-9 <= math.radians(at) <= LIMITS[servo][1] + 1e-9 for servo, at in pose.angles.items()
        )
        assert math.dist(HUMANOID.place(part, pose.angles), place) == pytest.approx(pose.distances[part], abs=1e-6)
        reached += pose.is_reached
    assert reached >= 24


@pytest.mark.slow
def test_of_400_random_places_95_in_100_are_reached() -> None:
    for part, servos in (
        ("l_elbow", (4, 5, 6)),
        ("r_elbow", (1, 2, 3)),
        ("l_foot", range(12, 17)),
        ("r_foot", range(7, 12)),
    ):
        random = Random(part)
        places = [
            HUMANOID.place(part, {servo: math.degrees(random.uniform(*LIMITS[servo])) for servo in servos})
            for _ in range(100)
        ]
        assert sum(HUMANOID.reach({part: place}).is_reached for place in places) >= 95


def test_places_out_of_reach_end_at_the_nearest_pose() -> None:
    arm = PosableFigure(figure(PENDULUM, **BASE))
    pose = arm.reach({"arm": (-1, 0, 0.5)})
    assert pose.angles == pytest.approx({1: 90}, abs=0.1)
    assert pose.distances == pytest.approx({"arm": 0.8}, abs=1e-4)
    assert not pose.is_reached
    pose = arm.reach({"arm": (1, 0, 0.5)})
    assert pose.degrees == {1: -60}, "the limit"
    assert pose.distances["arm"] == pytest.approx(math.dist((0.2 * math.sin(1.0472), 0.4), (1, 0.5)), abs=1e-4)


def test_a_pose_begins_at_the_start_and_is_the_same_each_time() -> None:
    place = HUMANOID.place("left hand", {4: -40, 5: -20, 6: -30})
    near = HUMANOID.reach({"left hand": place}, {4: -42, 5: -18, 6: -33})
    assert near.angles == pytest.approx({4: -40, 5: -20, 6: -30}, abs=3)
    far = HUMANOID.place("left hand", {4: -170, 5: -150, 6: 80})
    assert HUMANOID.reach({"left hand": far}) == HUMANOID.reach({"left hand": far})


def test_several_parts_move_together_and_followers_follow() -> None:
    places = {"left hand": (0.1, 0.1, 0.3), "right hand": (0.1, -0.1, 0.3)}
    pose = HUMANOID.reach(places)
    assert pose.is_reached
    assert pose.angles.keys() == {1, 2, 3, 4, 5, 6}
    copy = {"id": "copy", "at": [100, 0, 0], "follows": 1, "shapes": [LIMB], "tip": [0, -200, 0]}
    both = PosableFigure(figure(PENDULUM, copy, **BASE))
    assert both.reach({"copy": both.place("arm", {1: 30})}).angles == pytest.approx({1: 30}, abs=20)
    assert both.place("copy", {1: 30})[2] == pytest.approx(both.place("arm", {1: 30})[2])


@pytest.mark.parametrize(("part", "place"), [("head", (0, 0, 0.308)), ("left hand", (1, 0, 0.3))])
def test_a_part_beyond_its_limb_bends_the_legs_and_the_robot_stands(part: str, place: Vector) -> None:
    pose = HUMANOID.reach({part: place})
    assert pose.angles.keys() >= set(range(7, 17)), "the servos of the legs"
    assert pose.is_reached == (part == "head")
    simulation = Simulation(Physics(Body.of(template("humanoid-16"))), Hardware(16))
    for servo, degrees in pose.degrees.items():
        simulation.hardware.servos[servo].move(degrees, 2.0, 0.0)
    simulation.advance(4.0)
    assert {("floor", "l_foot"), ("floor", "r_foot")} == {
        pair for pair in simulation.physics.touching() if "floor" in pair
    }
    if pose.is_reached:
        assert simulation.physics.data.body("head").xpos == pytest.approx(place, abs=0.03)


def test_the_file_of_a_project_has_the_figure() -> None:
    assert load_figure(DEMO).place("left foot") == pytest.approx((0.01, 0.029, 0), abs=1e-6)
    assert load_figure(DEMO).place("left hand") == pytest.approx((0, 0.084, 0.178), abs=1e-6)
    assert REACHED == 0.003


@pytest.mark.parametrize(
    ("places", "reason"),
    [
        ({}, "no part is named"),
        ({"tail": (0, 0, 0)}, "has no part 'tail'; known are 'pelvis', .*'left arm'"),
        ({"": (0, 0, 0)}, "has no part ''"),
        ({"left hand": (0, 0)}, "'left hand' must be three numbers in metres, not \\(0, 0\\)"),
        ({"left hand": (0, math.nan, 0)}, "three numbers"),
        ({"left hand": (0, 0, 1e308)}, "three numbers"),
        ({"left hand": "far"}, "three numbers"),
    ],
)
def test_wrong_questions_are_one_error(places: dict[str, Any], reason: str) -> None:
    standing = {} if places else BASE
    asked = HUMANOID if places else PosableFigure(figure(PENDULUM, **standing))
    with pytest.raises(TwinError, match=reason):
        asked.reach(places)


def test_a_part_that_no_servo_moves_is_refused() -> None:
    fixed = PosableFigure(figure({"id": "plate", "at": [90, 0, 0], "shapes": [LIMB]}, PENDULUM, **BASE))
    with pytest.raises(TwinError, match="no servo moves 'plate'"):
        fixed.reach({"plate": (0, 0, 0)})
