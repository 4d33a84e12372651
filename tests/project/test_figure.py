"""The figure of a project file: what it may hold, what is refused, and where it goes."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from servolink.errors import ProjectError
from servolink.project import ProjectFile
from servolink.project.figure import COLOURS, Feet, Figure, FixedBase, Joint, Shape, View
from servolink.project.model import Project
from servolink.project.project_file import load_project, save_project
from servolink.protocol import Action, Step
from servolink.studio import page_files
from tests.cli.programs import call
from tests.project.test_file import ROBOT, TEXT

ARM = Figure(1, "Arm", View(), (Joint("base"), Joint("elbow", "base", servo=1, limits=(-90, 45.5))))
TEMPLATES = [path for path in page_files() if path.endswith(".figure.json")]


def test_a_file_without_figure_is_written_as_before() -> None:
    read = ProjectFile.parse(TEXT)
    assert read.figure is None
    assert ProjectFile(read.project, figure=read.figure).text() == TEXT


def test_a_file_keeps_its_figure(tmp_path: Path) -> None:
    path = tmp_path / "robot"
    save_project(path, ROBOT, figure=ARM)
    assert ProjectFile.read(path) == (ROBOT.sorted(), False, ARM, None)
    save_project(path, Project(7))
    assert ProjectFile.read(path) == (Project(7), False, ARM, None)
    other = replace(ARM, name="Other")
    save_project(path, Project(7), figure=other)
    assert ProjectFile.read(path).figure == other


def test_a_project_has_no_figure(tmp_path: Path) -> None:
    save_project(tmp_path / "robot", ROBOT, figure=ARM)
    assert load_project(tmp_path / "robot") == ROBOT.sorted()


def test_commands_keep_the_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "robot.json", tmp_path / "out.json"
    save_project(path, Project(actions=(Action(1, "Up", (Step(1, 30, 30),)),)), figure=ARM)
    for where in (["-o", str(out)], ["--in-place"]):
        assert call(capsys, "project", "rename", str(path), "action", "Up", "New", *where).code == 0
    assert call(capsys, "plan", str(path), "--url", "virtual://?servos=2").code == 1
    assert call(capsys, "export", str(path), "--yes", "--url", "virtual://?servos=2").code == 0
    assert ProjectFile.read(path) == (Project(), False, ARM, None)
    assert ProjectFile.read(out).figure == ARM


def test_whole_numbers_are_written_as_such() -> None:
    assert ARM.to_json()["joints"][1]["limits"] == [-90, 45.5]
    assert (
        '{"id": "elbow", "parent": "base", "servo": 1, "limits": [-90, 45.5]}\n'
        in ProjectFile(Project(), figure=ARM).text()
    )


def test_joints_are_sorted_after_their_parents() -> None:
    joints = (Joint("hand", "arm"), Joint("arm", "body"), Joint("other"), Joint("body"), Joint("head", "body"))
    found = replace(ARM, joints=joints).checked()
    assert [joint.id for joint in found.joints] == ["body", "arm", "hand", "other", "head"]


@pytest.mark.parametrize("path", TEMPLATES)
def test_templates_are_right(path: str) -> None:
    value = json.loads(page_files()[path].content)
    figure = Figure.from_json(value)
    servos = sorted(joint.servo for joint in figure.joints if isinstance(joint.servo, int))
    assert servos == list(range(1, len(servos) + 1))
    assert path.endswith(f"-{len(servos)}.figure.json")
    assert [joint.id for joint in figure.joints] == [joint["id"] for joint in value["joints"]], "the page does not sort"


def joint(**fields: Any) -> dict[str, Any]:
    return {"joints": [{"id": "a", **fields}]}


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"figure": 3}, "figure.figure: 3 is newer than 2, the newest this servolink reads; update servolink"),
    ({"figure": "1"}, "figure.figure: must be one of 1, 2, not '1'"),
    ({"wheels": 4}, "figure: 'wheels' is not a field; the fields are figure, name, view, joints, base, groups, body"),
    ({"name": "q" * 65}, f"figure.name: '{'q' * 65}' has 65 characters; at most 64"),
    ({"view": {"pitch": 91}}, "figure.view.pitch: must be at least -90 and at most 90, not 91"),
    ({"view": {"yaw": True}}, "figure.view.yaw: must be a number, not true"),
    ({"joints": []}, "figure.joints: a figure needs at least one joint"),
    ({"joints": [{"id": "a"}] * 65}, "figure.joints: has 65 items; at most 64"),
    ({"joints": [{"id": "a"}, {"id": "a"}]}, "figure.joints[1].id: 'a' is also used in joints[0]"),
    (
        {"joints": [{"id": "a", "servo": 1}, {"id": "b", "servo": 1}]},
        "figure.joints[1].servo: 1 is also used in joints[0]",
    ),
    (joint(parent="b"), "figure.joints[0].parent: there is no joint 'b'"),
    (joint(parent="a"), "figure.joints[0].parent: a joint cannot hang on itself ('a' -> 'a')"),
    (
        {"joints": [{"id": "c", "parent": "a"}, {"id": "a", "parent": "b"}, {"id": "b", "parent": "a"}]},
        "figure.joints[0].parent: a joint cannot hang on itself ('a' -> 'b' -> 'a')",
    ),
    (joint(follows=1), "figure.joints[0].follows: no joint has servo 1"),
    (
        joint(servo=1, follows=1),
        "figure.joints[0].follows: a joint has a servo or follows another servo, not both",
    ),
    (joint(servo=255), "figure.joints[0].servo: 255 is outside 0..254"),
    (joint(group="ra"), "figure.joints[0].group: 'ra' is not among the groups of the figure"),
    ({"groups": {"tail": {}}}, f"figure.groups: 'tail' is not a group; the groups are {', '.join(COLOURS)}"),
    ({"groups": {"ra": {"en": 1}}}, "figure.groups: 'ra': 'en' must be text, not 1"),
    ({"groups": {"ra": 1}}, "figure.groups: 'ra': must be an object, not 1"),
    (joint(axis="w"), "figure.joints[0].axis: must be one of x, y, z, not 'w'"),
    (joint(axis=[1, 2]), "figure.joints[0].axis: must be a list of 3 items, not [1, 2]"),
    (joint(axis=[0, 0, 0]), "figure.joints[0].axis: an axis needs a direction, not [0, 0, 0]"),
    (joint(axis=[0, 1e-320, 0]), "figure.joints[0].axis: an axis needs a direction, not [0, 9.99989e-321, 0]"),
    (joint(axis=[0, 0, "x"]), "figure.joints[0].axis[2]: must be a number, not 'x'"),
    (joint(at=[0, 1e5, 0]), "figure.joints[0].at[1]: must be at least -5000 and at most 5000, not 100000.0"),
    (joint(sign=2), "figure.joints[0].sign: must be one of -1, 1, not 2"),
    (joint(offset=400), "figure.joints[0].offset: must be at least -360 and at most 360, not 400"),
    (
        joint(servo=1, measured={"on": "2026-11-30", "movements": 8, "speed": [290, 300, 310]}),
        "figure.joints[0].measured.speed: a value comes first, then the lowest and the highest around it",
    ),
    (joint(limits=[3, 1]), "figure.joints[0].limits: the lowest angle 3 is above the highest, 1"),
    (joint(shapes=[{}]), "figure.joints[0].shapes[0]: a shape has either a box or a disc"),
    (
        joint(shapes=[{"box": [1, 1, 1], "disc": [1, 1]}]),
        "figure.joints[0].shapes[0]: a shape has either a box or a disc",
    ),
    (
        joint(shapes=[{"box": [1, -1, 1]}]),
        "figure.joints[0].shapes[0].box[1]: must be at least 0 and at most 5000, not -1",
    ),
    ({"base": {}}, 'figure.base: "mode" is missing; it must be one of fixed, feet'),
    ({"base": {"mode": "wings"}}, "figure.base.mode: must be one of fixed, feet, not 'wings'"),
    ({"base": {"mode": "feet"}}, "figure.base: 'feet', 'sole' are missing"),
    (
        {"base": {"mode": "feet", "feet": ["a", "b"], "sole": [0, 0, 0]}},
        "figure.base.feet[1]: there is no joint 'b'",
    ),
]


@pytest.mark.parametrize(("change", "text"), REFUSED, ids=[text[:60] for _, text in REFUSED])
def test_a_wrong_figure_is_refused(change: dict[str, Any], text: str) -> None:
    value = {"figure": 1, "name": "x", "view": {}, "joints": [{"id": "a"}], **change}
    with pytest.raises(ProjectError) as raised:
        ProjectFile.parse(json.dumps({"schema": 1, "figure": value}))
    assert str(raised.value) == text


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999"])
def test_numbers_are_finite(number: str) -> None:
    text = ProjectFile(Project(), figure=ARM).text().replace("45.5", number)
    with pytest.raises(ProjectError, match=r"is not JSON|at most 360"):
        ProjectFile.parse(text)


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high) | st.integers(int(low), int(high)).map(float)


VECTORS = st.tuples(numbers(-5000, 5000), numbers(-5000, 5000), numbers(-5000, 5000))
SIZES = numbers(0, 5000)
TONES = st.sampled_from(["shell", "limb", "dark", "glow"])
SHAPES = st.builds(Shape, box=st.tuples(SIZES, SIZES, SIZES), at=VECTORS, round=SIZES, tone=TONES) | st.builds(
    Shape, disc=st.tuples(SIZES, SIZES), axis=st.sampled_from("xyz"), at=VECTORS, tone=TONES
)
BASES = st.builds(FixedBase, VECTORS) | st.builds(Feet, st.just(("0", "0")), VECTORS)


@st.composite
def figures(draw: st.DrawFn) -> Figure:
    joints = []
    for number in range(draw(st.integers(1, 12))):
        hangs = number and draw(st.booleans())
        parent = {"parent": str(draw(st.integers(0, number - 1)))} if hangs else {}
        servo = {"servo": number} if draw(st.booleans()) else {}
        low, high = sorted(draw(st.tuples(numbers(-360, 360), numbers(-360, 360))))
        axis = draw(st.sampled_from("xyz") | VECTORS.filter(lambda axis: math.hypot(*axis) > 1e-6))
        shapes = tuple(draw(st.lists(SHAPES, max_size=3)))
        group, sign = draw(st.sampled_from(["", "ra"])), draw(st.sampled_from([1, -1]))
        fields: dict[str, Any] = {**parent, **servo, "axis": axis, "group": group, "sign": sign, "shapes": shapes}
        joints.append(Joint(str(number), at=draw(VECTORS), limits=(low, high), **fields))
    view = View(yaw=draw(numbers(-360, 360)), target=draw(VECTORS))
    groups = {"ra": draw(st.dictionaries(st.text(max_size=3), st.text(max_size=9), max_size=2))}
    return Figure(1, draw(st.text(max_size=64)), view, tuple(joints), draw(BASES), groups)


@given(figures())
def test_a_figure_comes_back_from_a_file(figure: Figure) -> None:
    text = ProjectFile(Project(), figure=figure).text()
    read = ProjectFile.parse(text)
    assert read.figure == figure
    assert ProjectFile(read.project, figure=read.figure).text() == text
