"""Figures from URDF files: what is exported comes back, meshes become shapes, and hostile files are refused in time.

Module: servolink.twin.urdf_reading, servolink.twin.meshes, servolink.cli.projects.figures.
"""

from __future__ import annotations

import math
import struct
import time
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import ProjectError
from servolink.project import Figure, ProjectFile, Shape
from servolink.twin.body import Body
from servolink.twin.simulation import Physics
from servolink.twin.urdf import to_urdf
from servolink.twin.urdf_reading import MOST_BYTES, UrdfFigure, read_urdf
from tests.cli.programs import call
from tests.twin.figures import DEMO, figure, template
from tests.twin.test_urdf import FIGURES, assert_same_frames, in_mjcf, in_urdf, random_poses

Vertex = tuple[float, float, float]
BOX = '<visual><geometry><box size="0.02 0.02 0.2"/></geometry></visual><inertial><mass value="0.2"/>'
BOX += '<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial>'


def robot(*parts: str) -> str:
    return f'<robot name="r">{"".join(parts)}</robot>'


def link(name: str, inside: str = BOX) -> str:
    return f'<link name="{name}">{inside}</link>'


def joint(name: str, parent: str, child: str, inside: str = "", kind: str = "revolute") -> str:
    limit = '<limit lower="-1" upper="1" effort="2" velocity="3"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{limit}{inside}</joint>'


def chain(*kinds: str) -> str:
    """Return a robot of links a, b, c ... with joints of these kinds, each 0.2 m above the last."""
    names = "abcdefgh"
    made = [joint(f"j{at}", names[at], names[at + 1], kind=kind) for at, kind in enumerate(kinds)]
    return robot(*map(link, names[: len(kinds) + 1]), *made)


def read(folder: Path, text: str | bytes) -> UrdfFigure:
    path = folder / "robot.urdf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    return read_urdf(path)


def only_shape(found: UrdfFigure) -> Shape:
    """Return the shape of the only part."""
    shapes = found.figure.joints[0].shapes or ()
    assert len(shapes) == 1
    return shapes[0]


@pytest.mark.parametrize("name", FIGURES)
def test_an_exported_figure_comes_back_byte_by_byte(name: str, tmp_path: Path) -> None:
    of = template(name)
    text = to_urdf(of)
    found, captions, warnings = read(tmp_path, text)
    assert to_urdf(found, captions) == text
    assert warnings == []
    assert [joint.servo for joint in found.joints] == [joint.servo for joint in of.joints]
    assert Physics(Body.of(found)).model.nu == len(Body.of(of).drives), "parts that overlap do not fight in the twin"
    poses = random_poses(Body.of(of), 100)
    expected = in_mjcf(of, poses)
    assert_same_frames({part: frames for part, frames in in_mjcf(found, poses).items() if part in expected}, expected)


def floats(low: float, high: float) -> st.SearchStrategy[float]:
    """Return numbers with at most six decimals, as people and programs write them."""
    return st.integers(round(low * 1e6), round(high * 1e6)).map(lambda number: number / 1e6)


ANGLES = floats(-360, 360)
PLACES = st.tuples(*[floats(-2000, 2000)] * 3)
JOINTS = st.fixed_dictionaries(
    {
        "at": PLACES,
        "axis": st.sampled_from(["x", "y", "z"]),
        "sign": st.sampled_from([1, -1]),
        "offset": ANGLES,
        "limits": st.tuples(ANGLES, ANGLES).map(sorted).filter(lambda ends: ends[0] < ends[1]),
        "torque": floats(0.001, 1000),
        "speed": floats(1, 10_000),
        "mass": floats(0.001, 1000),
        "shapes": st.lists(
            st.fixed_dictionaries({"box": st.tuples(*[floats(0.001, 900)] * 3), "at": PLACES})
            | st.fixed_dictionaries({"disc": st.tuples(*[floats(0.001, 900)] * 2), "axis": st.sampled_from("xyz")}),
            max_size=2,
        ),
    }
)


@given(joints=st.lists(JOINTS, min_size=1, max_size=4), base=PLACES, follows=st.booleans())
def test_any_figure_comes_back(
    tmp_path_factory: pytest.TempPathFactory, joints: list[dict[str, Any]], base: Vertex, *, follows: bool
) -> None:
    for at, each in enumerate(joints):
        each.update({"id": f"part {at}", "servo": at} | ({"parent": f"part {at - 1}"} if at else {}))
    if follows:
        joints.append({"id": "copy", "follows": 0, "mass": 0.1, "parent": joints[-1]["id"], "sign": -1})
    text = to_urdf(figure(*joints, base={"mode": "fixed", "at": base}))
    found, captions, _ = read(tmp_path_factory.getbasetemp(), text)
    assert to_urdf(found, captions) == text


@given(
    st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda axis: math.hypot(*axis) > 0.1),
    st.tuples(*[st.floats(-7, 7)] * 3),
    st.tuples(*[st.floats(-1, 1)] * 3),
    st.sampled_from(["revolute", "fixed"]),
)
def test_links_of_any_file_are_where_mujoco_has_them(
    tmp_path_factory: pytest.TempPathFactory, axis: Vertex, rpy: Vertex, xyz: Vertex, kind: str
) -> None:
    inside = f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>'
    inside += f'<axis xyz="{" ".join(map(str, axis))}"/>'
    joints = (joint("j", "base_link", "a", inside, kind), joint("k", "a", "b", inside, kind), joint("l", "b", "c"))
    text = robot(link("base_link", ""), *map(link, "abc"), *joints)
    found = read(tmp_path_factory.getbasetemp(), text).figure
    turning = [name for name in "jkl" if name == "l" or kind == "revolute"]
    servos = {name: at for at, name in enumerate(turning, 1)}
    poses = [{servo: 50 * math.sin(servo * at) for servo in servos.values()} for at in range(3)]
    frames = in_mjcf(found, poses)
    assert_same_frames({name: frames[name] for name in "abc"}, in_urdf(text, poses, servos))


def test_what_is_not_supported_is_named(tmp_path: Path) -> None:
    twice = joint("t", "a", "t", '<mimic joint="j0" multiplier="2"/>')
    text = chain("revolute", "prismatic", "continuous").replace(
        "</robot>", link("t", "<visual><geometry><capsule/></geometry></visual>") + twice + "<gazebo/><gazebo/></robot>"
    )
    _, captions, warnings = read(tmp_path, text)
    assert captions == {1: "j0", 2: "j2"}
    assert sorted(warnings) == [
        "joint 'j1': a 'prismatic' joint is not supported, and is fixed here",
        "joint 'j2' has no limits, and gets -180 and 180 degrees",
        "joint 't' copies 2 times another joint, which is not supported, and is fixed here",
        "left out, as a figure has nothing like it: 2 '<gazebo>'",
        "link 't': shape '' is left out: a figure has nothing like '<capsule>'",
        "servos are numbered limb by limb, from the root; see to it that they fit the robot",
    ]


def test_a_joint_that_copies_the_opposite_follows(tmp_path: Path) -> None:
    copy = joint("copy", "a", "c", '<mimic joint="j0" multiplier="-1" offset="0.5"/>')
    found = read(tmp_path, chain("revolute").replace("</robot>", link("c") + copy + "</robot>")).figure
    one = found.joints[2]
    assert (one.follows, one.axis, one.sign) == (1, "z", -1)
    assert one.offset == pytest.approx(math.degrees(0.5)), "-(angle) + 0.5 about the axis"


def test_servos_are_numbered_from_the_root_limb_by_limb(tmp_path: Path) -> None:
    joints = [joint("tip", "b", "d"), joint("knee", "c", "e"), joint("hip", "a", "b"), joint("neck", "a", "c")]
    assert read(tmp_path, robot(*map(link, "abcde"), *joints)).captions == {1: "hip", 2: "tip", 3: "neck", 4: "knee"}


@pytest.mark.parametrize("angle", ["1.57", "1.5708", "-1.57079632679"])
def test_what_is_nearly_a_right_angle_counts_as_one(angle: str, tmp_path: Path) -> None:
    wheel = f'<visual><origin rpy="0 {angle} 0"/><geometry><cylinder radius="0.1" length="0.02"/></geometry></visual>'
    found = read(tmp_path, robot(link("a", wheel)))
    shape = only_shape(found)
    assert (shape.disc, shape.axis, found.warnings) == ((100, 20), "z", [])


def box_corners(*size: float) -> list[Vertex]:
    return [(x, y, z) for x, y, z in product(*((-one / 2, one / 2) for one in size))]


def circle(radius: float, length: float) -> list[Vertex]:
    """Return points on the edges of a disc along x that begins at 0."""
    turns = [math.tau * at / 48 for at in range(48)]
    return [(x, radius * math.cos(turn), radius * math.sin(turn)) for x in (0, length) for turn in turns]


def stl(points: list[Vertex]) -> bytes:
    triangles = [points[at : at + 3] for at in range(0, len(points) - 2, 1)]
    packed = b"".join(struct.pack("<12f2x", 0, 0, 0, *(one for each in three for one in each)) for three in triangles)
    return bytes(80) + len(triangles).to_bytes(4, "little") + packed


def stl_text(points: list[Vertex]) -> bytes:
    return ("solid x\n" + "\n".join(f"  vertex {x} {y} {z}" for x, y, z in points) + "\nendsolid x\n").encode()


def meshed(folder: Path, content: bytes, name: str = "part.stl", more: str = "") -> UrdfFigure:
    (folder / "meshes").mkdir(exist_ok=True)
    (folder / "meshes/part.stl").write_bytes(content)
    visual = f'<visual><geometry><mesh filename="{name}" {more}/></geometry></visual>'
    return read(folder, robot(link("a", visual)))


@pytest.mark.parametrize("name", ["meshes/part.stl", "package://meshes/part.stl", "package://robot/meshes/part.stl"])
@pytest.mark.parametrize("form", [stl, stl_text])
def test_a_mesh_becomes_a_box(name: str, form: Any, tmp_path: Path) -> None:
    found = meshed(tmp_path, form(box_corners(10, 20, 30)), name, 'scale="0.001 0.001 0.002"')
    shape = only_shape(found)
    assert found.warnings == []
    assert shape.box == pytest.approx((20, 60, 10), rel=1e-6), "in a figure, y is up"


def test_a_round_mesh_becomes_a_disc(tmp_path: Path) -> None:
    shape = only_shape(meshed(tmp_path, stl(circle(0.02, 0.01)), "meshes/part.stl"))
    assert shape.disc == pytest.approx((20, 10), rel=1e-3)
    assert shape.axis == "z"
    assert shape.at == pytest.approx((0, 0, 5), abs=1e-3)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("../secret.stl", stl(box_corners(1, 1, 1)), "outside the folder"),
        ("package://../secret.stl", stl(box_corners(1, 1, 1)), "outside the folder"),
        ("/etc/passwd", b"", "outside the folder"),
        ("link.stl", b"", "outside the folder"),
        ("file:///etc/passwd", b"", "only files beside"),
        ("http://x/y.stl", b"", "only files beside"),
        ("meshes/none.stl", b"", "No such file"),
        ("meshes", b"", "regular file|directory"),
        ("meshes/part.stl", b"solid x\nvertex 1 2 nan\n", "not an STL file"),
        ("meshes/part.stl", b"solid x\nvertex 1 2 x\n", "not an STL file"),
        ("meshes/part.stl", stl([(math.inf, 0, 0)] * 3), "not an STL file"),
        ("meshes/part.stl", bytes(84), "not an STL file"),
        ("meshes/part.stl", stl(box_corners(1, 1, 1))[:-1], "not an STL file"),
        ("meshes/part.stl", bytes(17 << 20), "is larger than 16 MiB"),
    ],
)
def test_no_other_mesh_is_read(name: str, content: bytes, reason: str, tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    folder.mkdir()
    (tmp_path / "secret.stl").write_bytes(stl(box_corners(1, 1, 1)))
    (folder / "link.stl").symlink_to(tmp_path / "secret.stl")
    found = meshed(folder, content, name)
    assert not found.figure.joints[0].shapes
    [warning, *_] = found.warnings
    assert warning.startswith(f"link 'a': shape '{name}' is left out: ")
    assert np.any([one in warning for one in reason.split("|")]), warning


TILT = '<origin rpy="1 0 0"/><axis xyz="0 0 1"/>'
BOMB = "".join(f'<!ENTITY a{at} "{f"&a{at - 1};" * 10}">' for at in range(1, 9))
HOSTILE: dict[str, tuple[str | bytes, str]] = {
    "billion laughs": (f'<!DOCTYPE r [<!ENTITY a0 "x">{BOMB}]>{robot(link("&a8;"))}', "document type"),
    "external entity": ('<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot>&x;</robot>', "document type"),
    "external document type": ('<!DOCTYPE robot SYSTEM "http://127.0.0.1:9/x.dtd"><robot/>', "document type"),
    "a million links": (robot(*(f'<link name="l{at}"/>' for at in range(90_000))), "more than 20,000 elements"),
    "a million empty links": (b"<robot>" + b"<link/>" * 250_000, "more than 20,000 elements"),
    "deep nesting": ("<robot>" + "<link>" * 250_000, "more than 32 in each other"),
    "huge": (b"<robot>" + b" " * MOST_BYTES, "is larger than 2 MiB"),
    "huge attribute": (f'<robot name="{"x" * 2_000_000}"/>', "more than 1,000 characters"),
    "a million attributes": ("<robot " + " ".join(f"a{at}=''" for at in range(150_000)) + "/>", "at least one joint"),
    "half": (chain("revolute")[:100], "is not XML"),
    "empty": (b"", "is not XML"),
    "noise": (bytes(range(256)) * 100, "is not XML"),
    "unknown encoding": (b'<?xml version="1.0" encoding="nope"?><robot/>', "is not XML"),
    "odd encoding": (b'<?xml version="1.0" encoding="utf-7"?><robot/>', "is not XML"),
    "another format": ("<mujoco/>", "must be <robot>, not 'mujoco'"),
    "macros": ('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:if/></robot>', "xacro"),
    "no link": (robot(), "at least one joint"),
    "a circle": (robot(*map(link, "abc"), joint("j", "a", "b"), joint("k", "b", "a")), "cannot hang on itself"),
    "only a circle": (robot(*map(link, "ab"), joint("j", "a", "b"), joint("k", "b", "a")), "cannot hang on itself"),
    "itself": (robot(link("a"), joint("j", "a", "a")), "cannot hang on itself"),
    "two parents": (robot(*map(link, "abc"), joint("j", "a", "c"), joint("k", "b", "c")), "child of two joints"),
    "two roots": (robot(*map(link, "ab")), r"2 links without a parent \('a', 'b'\)"),
    "no such link": (robot(link("a"), joint("j", "a", "b")), "its child is not a link"),
    "same links": (robot(link("a"), link("a")), "two with the name 'a'"),
    "nameless": (robot("<link/>"), "link without a name"),
    "nan": (chain("revolute").replace('upper="1"', 'upper="nan"'), "upper must be a finite number, not 'nan'"),
    "inf": (chain("revolute").replace('lower="-1"', 'lower="-inf"'), "lower must be a finite number"),
    "huge number": (chain("revolute").replace("0.02 0.02 0.2", "1e308 1 1"), "box"),
    "no number": (chain("revolute").replace("0.02 0.02 0.2", "1 1"), "size must be 3 finite numbers, not '1 1'"),
    "limits": (chain("revolute").replace('upper="1"', 'upper="-2"'), "lowest angle"),
    "no axis": (chain("revolute").replace("</joint>", '<axis xyz="0 0 0"/></joint>'), "an axis needs a direction"),
    "same servo": (
        chain("revolute", "revolute").replace("</joint>", '<servolink servo="7"/></joint>'),
        "two joints have the same servo",
    ),
    "too many parts": (
        robot(link("a"), *(link(f"l{n}") + joint(f"j{n}", "a", f"l{n}") for n in range(99))),
        "has 100 links",
    ),
    "too many parts with mounts": (
        robot(link("a"), *(link(f"l{n}") + joint(f"j{n}", "a", f"l{n}", TILT) for n in range(40))),
        "64",
    ),
    "controls in names": (robot(link("a\tb&#x202e;"), link("c")), r"\('a b\\u202e', 'c'\)"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_within_a_second(name: str, tmp_path: Path) -> None:
    content, reason = HOSTILE[name]
    path = tmp_path / "robot.urdf"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    begun = time.process_time()
    with pytest.raises(ProjectError, match=reason) as caught:
        read_urdf(path)
    assert time.process_time() - begun < 1
    assert str(caught.value).startswith(f"{path}: ")
    assert str(caught.value).isprintable()


TEXTS = st.text(max_size=300).map(lambda text: robot(link("a"), text).encode("utf-8", "ignore"))


@given(st.binary(max_size=300) | TEXTS)
def test_any_bytes_are_read_or_refused_by_one_error(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    with suppress(ProjectError):
        assert read(tmp_path_factory.getbasetemp(), content).figure.joints


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match=r"none\.urdf: cannot be read"):
        read_urdf(tmp_path / "none.urdf")


def test_a_robot_without_a_body_is_read_all_the_same(tmp_path: Path) -> None:
    found = read(tmp_path, robot(link("a"), link("b", ""), joint("j", "a", "b")))
    assert found.figure.joints[1].servo == 1
    assert "the twin cannot have this robot" in found.warnings[-1]


def test_the_commands_write_and_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, back, again = (tmp_path / name for name in ("robot.urdf", "new.servolink.json", "again.urdf"))
    said = call(capsys, "figure", "export", str(DEMO), str(out))
    assert (said.code, said.err) == (0, "")
    assert said.out.endswith("robot.urdf: written, with 19 parts, 16 servos\n")
    said = call(capsys, "figure", "export", str(DEMO), str(out))
    assert (said.code, "exists already; --force replaces it" in said.err) == (1, True)
    said = call(capsys, "figure", "import", str(out))
    assert said.out.endswith("robot.urdf: 19 parts, 16 servos\nnothing was written; -o OUT or --into FILE does\n")
    assert call(capsys, "figure", "import", str(out), "-o", str(back)).code == 0
    assert call(capsys, "figure", "import", str(out), "-o", str(back)).code == 1, "it exists"
    assert ProjectFile.read(back).project.by_servo()[2].servo_caption == "R_arm"
    assert call(capsys, "figure", "export", str(back), str(again)).code == 0
    assert again.read_bytes() == out.read_bytes()


def test_a_figure_is_put_into_a_project_that_keeps_all_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf, target = tmp_path / "arm.urdf", tmp_path / "demo.servolink.json"
    urdf.write_text(to_urdf(template("arm-6")), encoding="utf-8")
    target.write_bytes(DEMO.read_bytes())
    said = call(capsys, "figure", "import", str(urdf), "--into", str(target))
    assert (said.code, "has a figure already; --force replaces it" in said.err) == (1, True)
    assert target.read_bytes() == DEMO.read_bytes()
    said = call(capsys, "figure", "import", str(urdf), "--into", str(target), "--force", "--json")
    assert said.json == {"file": str(target), "parts": 8, "servos": 6, "warnings": []}
    before, after = ProjectFile.read(DEMO), ProjectFile.read(target)
    assert after.project == before.project
    assert isinstance(after.figure, Figure)
    assert after.figure.name == "Arm_6_servos"


def test_a_project_without_a_figure_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.servolink.json"
    path.write_text('{"schema": 1}')
    said = call(capsys, "figure", "export", str(path), str(tmp_path / "x.urdf"))
    assert (said.code, "has no figure; `servolink studio` fits one" in said.err) == (1, True)
    assert not (tmp_path / "x.urdf").exists()
