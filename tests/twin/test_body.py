"""The body of a figure: masses and servos that are given, those that follow from sizes, and figures without a body.

Module: servolink.twin.body, servolink.twin.placement.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from servolink.errors import EncodeError, TwinError
from servolink.project import Figure, Project, save_project
from servolink.twin.body import DENSITY, FULL_LAG, GRAVITY, TORQUE_SHARE, TORQUE_SPARE, Body
from servolink.twin.placement import Placement
from tests.twin.figures import DEMO, LIMB, arm, body, box, figure, template

LITRE = {"box": [100, 100, 100]}


def test_masses_follow_from_sizes() -> None:
    made = body(
        {"id": "base", "shapes": [LITRE]},
        {"id": "arm", "parent": "base", "servo": 1, "shapes": [{"disc": [10, 100]}, {"box": [10, 10, 10]}]},
        {"id": "hand", "parent": "arm", "length": 100, "width": 20},
    )
    disc, cube = math.pi * 0.01**2 * 0.1, 1e-6
    assert [part.mass for part in made.parts] == pytest.approx([0.6, 600 * (disc + cube), 600 * 0.02 * 0.02 * 0.1])
    assert sum(solid.mass for solid in made.parts[1].solids) == pytest.approx(made.parts[1].mass)
    assert DENSITY == 600


def test_the_mass_of_the_robot_is_shared_by_volume_after_the_masses_given() -> None:
    joints: list[dict[str, Any]] = [
        {"id": "base", "shapes": [LITRE]},
        {"id": "battery", "parent": "base", "shapes": [LITRE], "mass": 0.5},
        {"id": "top", "parent": "base", "shapes": [LITRE, LITRE]},
    ]
    assert [part.mass for part in body(*joints, body={"mass": 2}).parts] == pytest.approx([0.5, 0.5, 1.0])
    assert [part.mass for part in body(*joints, body={"density": 1000}).parts] == pytest.approx([1, 0.5, 2])


def test_servos_follow_from_weight_and_size() -> None:
    ((_, drive),) = arm().drives.values()
    weakest = TORQUE_SPARE * GRAVITY * 0.4 * 0.1
    assert drive.torque == pytest.approx(weakest)
    assert drive.stiffness == pytest.approx(weakest / math.radians(FULL_LAG))
    heavy = body({"id": "base", "shapes": [LITRE], "mass": 9}, {"id": "arm", "servo": 1, "shapes": [LIMB], "mass": 0.4})
    ((_, drive),) = heavy.drives.values()
    assert drive.torque == pytest.approx(TORQUE_SHARE * GRAVITY * 9.4 * 0.25)
    assert drive.speed == pytest.approx(math.radians(300))


def test_values_of_a_joint_count_before_those_of_the_body() -> None:
    made = body(
        {"id": "one", "servo": 1, "shapes": [LIMB], "torque": 2, "stiffness": 0.5},
        {"id": "other", "servo": 2, "shapes": [LIMB], "speed": 90},
        body={"torque": 1, "speed": 180},
    )
    one, other = (drive for _, drive in made.drives.values())
    assert (one.torque, math.degrees(one.speed), math.radians(one.stiffness)) == pytest.approx((2, 180, 0.5))
    assert (other.torque, math.degrees(other.speed), math.radians(other.stiffness)) == pytest.approx((1, 90, 0.2))


def test_free_bodies_stand_on_the_floor_and_bolted_ones_where_they_are_drawn() -> None:
    assert Body.of(template("humanoid-16")).base == pytest.approx((0, 0, 0.192))
    assert box().base == pytest.approx((0, 0, 0.05))
    assert arm().base == pytest.approx((0, 0, 0.5))
    assert arm().has_floor
    assert not body({"id": "arm", "servo": 1, "shapes": [LIMB]}).has_floor, "the limb hangs below the floor"


def test_a_pose_is_in_the_frame_of_the_one_before() -> None:
    place = Placement().child((0, 0, 1), (0, 1, 0), math.pi / 2).child((0, 0, 1), (1, 0, 0), math.pi / 2)
    assert place.point((0, 1, 0)) == pytest.approx((2, 0, 1))


def test_every_field_survives_the_file() -> None:
    fields = {"mass": 2, "torque": 1.5, "speed": 200, "stiffness": 0.2, "friction": 0.6, "bolted": False}
    joint = {"id": "arm", "shapes": [LIMB], "mass": 0.1, "torque": 1, "speed": 100, "stiffness": 0.1}
    form = {"figure": 1, "name": "Test", "view": {}, "joints": [joint], "body": fields | {"touching": [["arm", "arm"]]}}
    assert Figure.from_json(form).to_json() == form


@pytest.mark.parametrize(
    ("fields", "place"),
    [
        ({"mass": 0}, "body.mass"),
        ({"mass": "heavy"}, "body.mass"),
        ({"density": -1}, "body.density"),
        ({"friction": 0}, "body.friction"),
        ({"torque": -1}, "body.torque"),
        ({"touching": [["arm"]]}, r"body.touching\[0\]"),
        ({"touching": [["arm", "leg"]]}, r"body.touching\[0\]"),
        ({"weight": 1}, "body"),
    ],
)
def test_wrong_values_are_refused_with_their_place(fields: dict[str, Any], place: str) -> None:
    with pytest.raises(EncodeError, match=place):
        figure({"id": "arm", "shapes": [LIMB]}, body=fields)


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        (figure({"id": "arm", "servo": 1}), "'arm' turns and weighs nothing; give it a mass"),
        (figure({"id": "arm"}, body={"bolted": False}), "the base stands free and weighs nothing"),
        (figure({"id": "a", "shapes": [LIMB]}, body={"mass": 1, "density": 1}), "not both"),
        (figure(*({"id": f"{at}", "shapes": [LIMB] * 57} for at in range(9))), "at most 512 shapes, .* has 513"),
        (figure({"id": "a", "shapes": [LIMB]}, {"id": "b", "mass": 2}, body={"mass": 1}), "1 kg is too little"),
    ],
)
def test_a_figure_without_possible_body_is_refused(made: Figure, reason: str) -> None:
    with pytest.raises(TwinError, match=reason):
        Body.of(made)


def test_a_part_may_carry_the_mass_of_the_parts_fixed_to_it() -> None:
    assert body({"id": "joint", "servo": 1}, {"id": "limb", "parent": "joint", "shapes": [LIMB]}).mass > 0


def test_a_project_needs_a_figure(tmp_path: Path) -> None:
    save_project(tmp_path / "robot.json", Project())
    with pytest.raises(TwinError, match=r"robot\.json: has no figure.*servolink studio"):
        Body.read(tmp_path / "robot.json")
    project, made = Body.read(DEMO)
    assert (len(project.macros), len(made.drives)) == (7, 16)


def test_the_demo_project_has_the_figure_of_the_studio() -> None:
    assert Body.read(DEMO)[1] == Body.of(template("humanoid-16"))
