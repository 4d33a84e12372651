"""URDF of a figure: links are where the model for MuJoCo and the page have them, and names are valid in ROS.

Module: servolink.twin.urdf.
"""

from __future__ import annotations

import json
import math
import random
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from servolink.project import Feet, Figure
from servolink.twin.body import Body, metres
from servolink.twin.mjcf import BASE, model_text, part_names
from servolink.twin.simulation import Physics, mujoco
from servolink.twin.urdf import ros_names, to_urdf
from tests.studio.web_code import call_all, needs_node
from tests.twin.figures import DEMO, LIMB, figure, template

FIGURES = ("arm-6", "quadruped-12", "hexapod-18", "humanoid-16")
POSES = 1000
NEAR = 1e-4
"""Metres by which a point may be elsewhere."""
SMALL = math.radians(0.1)


def random_poses(body: Body, number: int = POSES) -> list[dict[int, float]]:
    """Return poses within the limits of all servos, by servo id, in degrees."""
    chance = random.Random(body.name)
    drawn = ((servo, part.limits) for servo, (part, _) in body.drives.items())
    ranges = {servo: (math.degrees(low), math.degrees(high)) for servo, (low, high) in drawn}
    return [{servo: chance.uniform(*each) for servo, each in ranges.items()} for _ in range(number)]


Frames = dict[str, Any]
"""Places and rotations of a part in each pose, 12 numbers each, by name of the part."""


def in_model(model: Any, names: Mapping[str, str], turns: Mapping[str, int], poses: list[dict[int, float]]) -> Frames:
    """Return the frames of bodies of a MuJoCo model; `turns` are the servos that turn joints."""
    data, found = mujoco().MjData(model), []
    if model.jnt_type[0] == mujoco().mjtJoint.mjJNT_FREE:
        data.qpos[:3] = 0
    at = [model.joint(joint).qposadr[0] for joint in turns]
    bodies = [model.body(name).id for name in names.values()]
    for pose in poses:
        data.qpos[at] = [math.radians(pose[servo]) for servo in turns.values()]
        mujoco().mj_kinematics(model, data)
        found.append(np.hstack([data.xpos[bodies], data.xmat[bodies]]))
    return dict(zip(names, np.stack(found, 1), strict=True))


def in_mjcf(of: Figure, poses: list[dict[int, float]]) -> Frames:
    """Return the frames in the model for MuJoCo, as if its base stood where that of the figure is."""
    body = Body.of(of)
    model, parts = (
        mujoco().MjModel.from_xml_string(model_text(body)),
        list(zip(body.parts, part_names(body), strict=True)),
    )
    model.body(BASE).pos[:] = body.base if isinstance(of.base, Feet) else metres(of.base.at)
    ids = {model.joint(model.body(name).jntadr[0]).name: part.servo for part, name in parts if part.servo is not None}
    frames = in_model(model, {part.name: name for part, name in parts}, ids, poses)
    if not body.bolted:  # the free joint has the place of the base
        for each in frames.values():
            each[:, :3] += model.body(BASE).pos
    return frames


def in_urdf(text: str, poses: list[dict[int, float]], servos: Mapping[str, int]) -> Frames:
    """Return the frames of all links, also of those that MuJoCo joins with others unless told not to."""
    spec = mujoco().MjSpec.from_string(text)
    spec.compiler.fusestatic = False
    links = {str(link.get("name")): str(link.get("name")) for link in ET.fromstring(text).iter("link")}  # noqa: S314
    del links["base_link"]
    return in_model(spec.compile(), links, servos, poses)


def servos_of(text: str) -> dict[str, int]:
    """Return the servo that turns each joint."""
    joints = {str(joint.get("name")): joint for joint in ET.fromstring(text).iter("joint")}  # noqa: S314
    found = {}
    for name, joint in joints.items():
        if joint.get("type") == "revolute":
            mimic = joint.find("mimic")
            servo = joints[name if mimic is None else str(mimic.get("joint"))].find("servolink")
            assert servo is not None
            found[name] = int(str(servo.get("servo")))
    return found


def assert_same_frames(found: Frames, expected: Frames) -> None:
    assert found.keys() == expected.keys()
    apart = np.stack([found[part] - expected[part] for part in expected])
    assert np.linalg.norm(apart[..., :3], axis=-1).max() < NEAR
    assert np.linalg.norm(apart[..., 3:], axis=-1).max() < math.sqrt(2) * SMALL, "a turn changes so much"


@pytest.mark.parametrize("name", FIGURES)
def test_links_are_where_the_model_for_mujoco_has_them(name: str) -> None:
    of = template(name)
    text, poses = to_urdf(of), random_poses(Body.of(of))
    assert_same_frames(in_urdf(text, poses, servos_of(text)), in_mjcf(of, poses))


@needs_node
@pytest.mark.parametrize("name", FIGURES)
def test_links_are_where_the_page_has_them(name: str) -> None:
    of = template(name)
    text, poses = to_urdf(of), random_poses(Body.of(of))
    [solved] = call_all([("../../../tests/studio/web_figure.js", "framesOf", [of.to_json(), poses])])
    x, y, z = (np.moveaxis(np.array(solved).reshape(POSES, -1, 4, 4), 3, 0)[row] for row in range(3))
    rows = [z, x, y]  # columns of a matrix: directions x, y and z, and the place in millimetres
    places = np.stack([row[..., 3] / 1000 for row in rows], -1)
    turns = np.stack([row[..., column] for row in rows for column in (2, 0, 1)], -1)
    frames = np.moveaxis(np.concatenate([places, turns], -1), 1, 0)
    shown = dict(zip((joint.id for joint in of.joints), frames, strict=True))
    assert_same_frames(in_urdf(text, poses, servos_of(text)), shown)


def test_mujoco_reads_the_file_of_each_figure(tmp_path: Path) -> None:
    for name in FIGURES:
        of = template(name)
        path = tmp_path / f"{name}.urdf"
        path.write_text(to_urdf(of), encoding="utf-8")
        model, body = mujoco().MjModel.from_xml_path(str(path)), Body.of(of)
        assert model.njnt == sum(part.servo is not None for part in body.parts)
        moving = [part for part in body.parts if part.servo is not None]
        for part in moving:
            low, high = model.joint(part.name).range
            assert (low, high) == pytest.approx(part.limits if part.drive else body.drives[part.servo or 0][0].limits)


def test_inertia_is_that_of_the_model_for_mujoco() -> None:
    of = template("humanoid-16")
    spec = mujoco().MjSpec.from_string(to_urdf(of))
    spec.compiler.fusestatic = False
    found, expected = spec.compile(), Physics(Body.of(of)).model
    for joint in of.joints:
        one, other = found.body(joint.id), expected.body(joint.id)
        assert one.mass == pytest.approx(other.mass, rel=1e-6)
        assert one.ipos == pytest.approx(other.ipos, abs=1e-9)
        assert sorted(one.inertia) == pytest.approx(sorted(other.inertia), rel=1e-4)


def test_joints_have_the_captions_of_their_servos() -> None:
    project = json.loads(DEMO.read_bytes())
    captions = {each["servo_id"]: each["servo_caption"] for each in project["servo_parameters"]}
    found = servos_of(to_urdf(Figure.from_json(project["figure"]), captions))
    assert {servo: name.replace("_", " ") for name, servo in found.items()} == captions
    assert servos_of(to_urdf(template("arm-6"), {1: "Turn!", 2: "手臂", 3: "Turn!", 4: "shoulder"})) == {
        "Turn": 1,
        "shoulder_2": 2,
        "Turn_2": 3,
        "shoulder": 4,
        "roll": 5,
        "jaw_r": 6,
        "jaw_l": 6,
    }


def test_a_part_held_at_one_angle_is_fixed_and_so_is_what_copies_it() -> None:
    limbs = [{"id": f"limb{x}", "at": [x, 400, 0], "shapes": [LIMB]} for x in (0, 100)]
    held = figure(limbs[0] | {"servo": 1, "limits": [0, 0]}, limbs[1] | {"follows": 1})
    assert servos_of(to_urdf(held)) == {}


WORDS = st.text(max_size=40) | st.sampled_from(["", "_", "3d", "a b", "a_b", "a_b_2", "a", "base_link", "\ud800", "手"])


@given(st.lists(WORDS, max_size=12))
@example(["a b", "a_b", "a_b_2"])
def test_names_are_valid_in_ros_different_and_stable(texts: list[str]) -> None:
    names = ros_names((text, f"servo_{at}") for at, text in enumerate(texts))
    assert all(re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) for name in names)
    assert len(set(names)) == len(texts)
    assert ros_names((name, "other") for name in names) == names


@given(st.lists(WORDS, min_size=2, max_size=6, unique=True), WORDS)
def test_any_names_give_a_file_that_mujoco_reads(ids: list[str], name: str) -> None:
    joints = [{"id": one, "at": [0, 300 * at, 0], "shapes": [LIMB], "servo": at} for at, one in enumerate(ids)]
    of = Figure.from_json({"figure": 1, "name": name, "view": {}, "joints": joints})
    model = mujoco().MjModel.from_xml_string(to_urdf(of, {0: name}))
    assert (model.nbody, model.njnt) == (len(ids) + 1, len(ids))


@given(st.tuples(*[st.integers(-9, 9)] * 3).filter(any), st.integers(-360, 360), st.sampled_from([1, -1]))
@example((0, 1, 0), 90, 1)
@example((1, 1, 1), 120, 1)
def test_any_axis_and_offset_give_the_same_frames(axis: tuple[int, int, int], offset: int, sign: int) -> None:
    arm = {"id": "arm", "servo": 1, "at": [10, 500, 20], "axis": axis, "offset": offset, "sign": sign, "shapes": [LIMB]}
    of = figure(arm, {"id": "hand", "parent": "arm", "axis": axis, "offset": offset, "at": [0, -250, 0], "mass": 0.1})
    poses = random_poses(Body.of(of), 5)
    assert_same_frames(in_urdf(to_urdf(of), poses, {"arm": 1}), in_mjcf(of, poses))
