"""Left and right exchanged, by captions and by a map."""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

import servolink.studio
from servolink.errors import ProjectError
from servolink.project.build import extend_project
from servolink.project.figure import Figure
from servolink.project.mirror import Mirror, mirror_by_captions, mirror_project, other_side
from servolink.project.model import Project
from servolink.protocol import Action, Macro, MacroCommand, ServoParameter, Step
from tests.project.projects import HUMANOID, NOD, RAISE, SHOW, WAVE

ARMS = Mirror({1: 2, 2: 1, 3: 4, 4: 3})


@pytest.mark.parametrize(
    ("caption", "other"),
    [
        ("left knee", "right knee"),
        ("Knee Right", "Knee Left"),
        ("LEFT", "RIGHT"),
        ("leftKnee", "rightKnee"),
        ("KneeLeft", "KneeRight"),
        ("kneeleft", "kneeright"),
        ("L knee", "R knee"),
        ("l_knee", "r_knee"),
        ("knee-R", "knee-L"),
        ("knee.l", "knee.r"),
        ("R2", "L2"),
        ("2L", "2R"),
        ("LKnee", "RKnee"),
        ("kneeL", "kneeR"),
        ("左膝", "右膝"),
        ("手(右)", "手(左)"),
        ("left and right", "right and left"),
        ("neck", "neck"),
        ("RGB lamp", "RGB lamp"),
        ("LED", "LED"),
        ("roll", "roll"),
        ("él", "él"),
        ("", ""),
    ],
)
def test_sides_in_captions(caption: str, other: str) -> None:
    assert other_side(caption) == other
    assert other_side(other) == caption


@given(st.text(alphabet="lLrR _-.aZéleftrigh左右1", max_size=20))
def test_the_other_side_of_the_other_side_names_the_same_servo(caption: str) -> None:
    assert other_side(other_side(caption)).casefold() == caption.casefold()


def test_an_action_is_mirrored_by_the_captions_of_its_servos() -> None:
    mirror = mirror_by_captions(HUMANOID, [RAISE])
    assert mirror.partners == {1: 2, 2: 1, 3: 4, 4: 3}
    project, said = mirror_project(HUMANOID, [RAISE], mirror)
    image = Action(3, "Raise right arm", (Step(2, -60, 50), Step(4, 30, 40), Step(5, 10, 20)))
    assert project == msgspec.structs.replace(HUMANOID, actions=(RAISE, NOD, image))
    assert said == ["action 1 'Raise left arm' mirrored as action 3 'Raise right arm'"]


def test_the_image_of_the_image_is_there_already() -> None:
    project, _ = mirror_project(HUMANOID, [RAISE], ARMS)
    again, said = mirror_project(project, [project.actions[-1]], ARMS)
    assert again == project
    assert said == ["action 3 'Raise right arm' already has an image: action 1 'Raise left arm'"]


def test_servos_with_the_same_sign_keep_their_angle() -> None:
    for given_servo in (3, 4):
        project, _ = mirror_project(HUMANOID, [RAISE], mirror_by_captions(HUMANOID, [RAISE], {given_servo}))
        assert project.actions[-1].steps == (Step(2, -60, 50), Step(4, -30, 40), Step(5, 10, 20))


def test_a_servo_that_is_its_own_partner_turns_the_other_way() -> None:
    project, said = mirror_project(HUMANOID, [NOD], Mirror({5: 5}))
    assert project.actions[-1] == Action(3, "Nod mirrored", (Step(5, -20, 30),))
    assert said == ["action 2 'Nod' mirrored as action 3 'Nod mirrored'"]


def test_what_looks_the_same_is_not_added() -> None:
    both = Action(9, "Both", (Step(1, 10, 5), Step(2, -10, 5)))
    project = extend_project(HUMANOID, both)
    assert mirror_project(project, [NOD, both], ARMS) == (
        project,
        [
            "action 2 'Nod' looks the same in the mirror: nothing added",
            "action 9 'Both' looks the same in the mirror: nothing added",
        ],
    )


def test_a_macro_is_mirrored_with_what_it_calls() -> None:
    project, said = mirror_project(HUMANOID, [SHOW], mirror_by_captions(HUMANOID, [SHOW]))
    wave = Macro(1, "Wave right", (MacroCommand(3, 0, 50, 2, 2000), *WAVE.commands[1:]))
    show = Macro(2, "Show mirrored", (MacroCommand(1, 2, total_interval=2300), *SHOW.commands[1:]))
    assert project.macros == (WAVE, SHOW, wave, show)
    assert project.actions[-1].action_caption == "Raise right arm"
    assert project.joystick_tables == HUMANOID.joystick_tables
    assert len(said) == 3


def test_an_angle_without_an_opposite_is_refused() -> None:
    lowest = Action(9, "Lowest", (Step(1, -0x8000, 5),))
    with pytest.raises(ProjectError, match="servo 1: the opposite of -32768 does not fit a step"):
        mirror_project(extend_project(HUMANOID, lowest), [lowest], ARMS)


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ((), "none of the servos has a caption with left or right.*1=2,3=4"),
        (
            (ServoParameter(1, 0, "left"),),
            "servo 1 has the caption 'left', and no servo has the caption 'right'; give the pairs, as in 1=2",
        ),
        ((ServoParameter(1, 0, "left"), ServoParameter(2, 0, "Left")), "2 servos have the caption 'left'"),
        (
            (ServoParameter(1, 0, "left"), ServoParameter(2, 0, "right"), ServoParameter(3, 0, "RIGHT")),
            "and 2 servos have the caption 'right'",
        ),
    ],
)
def test_pairs_that_are_not_clear_are_asked_for(parameters: tuple[ServoParameter, ...], text: str) -> None:
    project = Project(servo_parameters=parameters, actions=(RAISE,))
    with pytest.raises(ProjectError, match=text):
        mirror_by_captions(project, [RAISE])


def test_captions_of_other_servos_do_not_matter() -> None:
    doubled = (*HUMANOID.servo_parameters, ServoParameter(8, 0, "left hip"), ServoParameter(9, 0, "left hip"))
    project = msgspec.structs.replace(HUMANOID, servo_parameters=doubled)
    assert mirror_by_captions(project, [RAISE]) == mirror_by_captions(HUMANOID, [RAISE])


def test_a_macro_that_runs_itself_ends() -> None:
    one, two = Macro(1, "One", (MacroCommand(2, 2),)), Macro(2, "Two", (MacroCommand(1, 2), MacroCommand(1)))
    project = Project(servo_parameters=HUMANOID.servo_parameters, actions=(RAISE,), macros=(one, two))
    with pytest.raises(ProjectError, match=r"macro 1 'One' never ends: the macro runs itself"):
        mirror_project(project, [one], mirror_by_captions(project, [one]))


@pytest.fixture
def few_calls() -> Iterator[int]:
    """Let calls nest no deeper than 200 more; return a greater depth."""
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(len(inspect.stack(0)) + 200)
    yield 300
    sys.setrecursionlimit(before)


def test_macros_nest_as_deep_as_they_like(few_calls: int) -> None:
    deep = few_calls
    inner = (Macro(one, "", (MacroCommand(one - 1, 2),)) for one in range(2, deep + 1))
    project = msgspec.structs.replace(HUMANOID, macros=(Macro(1, "", (MacroCommand(1),)), *inner))
    mirrored, changes = mirror_project(project, [project.macros[-1]], ARMS)
    assert len(mirrored.macros) == 2 * deep
    assert mirrored.macros[-1].commands[0].command_id == 2 * deep - 1
    assert changes[-1] == f"macro {deep} '' mirrored as macro {2 * deep} ' mirrored'"
    endless = msgspec.structs.replace(project, macros=(Macro(1, "", (MacroCommand(deep, 2),)), *project.macros[1:]))
    with pytest.raises(ProjectError, match="macro 1 '' never ends"):
        mirror_project(endless, [endless.macros[-1]], ARMS)


def test_a_call_of_nothing_is_named() -> None:
    with pytest.raises(ProjectError, match="there is no action 9"):
        mirror_project(Project(macros=(Macro(1, "One", (MacroCommand(9),)),)), [Macro(1)], ARMS)


def test_nothing_is_lost_where_an_id_is_used_twice() -> None:
    with pytest.raises(ProjectError, match="action 1 exists twice"):
        mirror_project(Project(actions=(RAISE, RAISE)), [RAISE], ARMS)


_FIGURES = Path(servolink.studio.__file__).parent / "web/figures"


def figure(name: str) -> Figure:
    return Figure.from_json(json.loads((_FIGURES / f"{name}.figure.json").read_text(encoding="utf-8")))


def image_of(images: dict[int, Mirror.ServoImage], servo_id: int, degree: float) -> tuple[int, float]:
    image = images[servo_id]
    return image.servo, image.factor * degree + image.offset


def test_a_figure_is_mirrored_by_its_groups() -> None:
    images = Mirror.images(figure("humanoid-16"), {2: "right", 3: "left"})
    for one, other in [((2, 142.0), (5, -142.0)), ((9, 30.0), (14, -30.0)), ((16, 5.0), (11, -5.0))]:
        assert image_of(images, *one) == other
        assert image_of(images, *other) == one
    assert images[2].is_right != images[5].is_right


def test_the_image_of_the_image_is_the_servo_itself() -> None:
    for name in ("humanoid-16", "quadruped-12", "hexapod-18"):
        images = Mirror.images(figure(name), {})
        assert images
        for servo_id in images:
            for degree in (-50, 0, 33):
                assert image_of(images, *image_of(images, servo_id, degree)) == (servo_id, degree)


def test_offset_and_direction_of_the_joints_count() -> None:
    joints = [
        {"id": "left arm", "servo": 1, "group": "la", "axis": "x", "offset": 10},
        {"id": "right arm", "servo": 2, "group": "ra", "axis": [2, 0, 0], "sign": -1, "offset": 30},
        {"id": "head", "servo": 3, "axis": "y", "offset": 5},
    ]
    groups = {"la": {"en": "Left arm"}, "ra": {"en": "Right arm"}}
    form = {"figure": 1, "name": "", "view": {}, "groups": groups, "joints": joints}
    images = Mirror.images(Figure.from_json(form), {})
    assert image_of(images, 1, 25) == (2, -5)  # both arms at 35 degrees
    assert image_of(images, 2, -5) == (1, 25)
    assert image_of(images, 3, 7) == (3, -17)  # a head at 12 degrees looks to the other side
    assert [images[servo].is_right for servo in (1, 2, 3)] == [False, True, False]


def test_a_figure_without_sides_leaves_it_to_the_captions() -> None:
    assert Mirror.images(figure("arm-6"), {}) == {}
    captions = {1: "L arm", 2: "r  ARM", 3: "head", 4: "L leg", 5: "l leg", 6: "R leg"}
    assert Mirror.images(figure("arm-6"), captions) == Mirror.images(None, captions)
    assert Mirror.images(None, captions) == {
        1: Mirror.ServoImage(2, -1, 0, False),
        2: Mirror.ServoImage(1, -1, 0, True),
    }
