"""The model of a body: readable by MuJoCo for any tree of joints, and safe whatever the names are.

Module: servolink.twin.mjcf, servolink.cli.projects.twin.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.errors import TwinError
from servolink.twin import simulation
from servolink.twin.body import Body
from servolink.twin.mjcf import model_text
from servolink.twin.simulation import Physics, mujoco
from tests.cli.programs import call
from tests.twin.figures import DEMO, LIMB, arm, body, template


@pytest.mark.parametrize(
    ("name", "servos", "floor"),
    [
        ("humanoid-16", 16, {"l_foot", "r_foot"}),
        ("arm-6", 6, set()),
        ("quadruped-12", 12, None),
        ("hexapod-18", 18, None),
    ],
)
def test_every_template_has_a_body_that_rests(name: str, servos: int, floor: set[str] | None) -> None:
    physics = Physics(Body.of(template(name)))
    assert physics.model.nu == servos
    assert float(physics.model.body_mass.sum()) == pytest.approx(physics.body.mass)
    before = physics.data.qpos.copy()
    physics.advance(100)
    assert abs(physics.data.qpos - before).max() < 0.05, "nothing jumps"
    touched = {one for pair in physics.touching() for one in pair if "floor" in pair} - {"floor"}
    assert touched == (floor if floor is not None else {part for part in touched if part.endswith(("knee", "shin"))})


def test_a_joint_has_the_angle_of_its_servo() -> None:
    physics = Physics(arm(degrees=90))
    assert physics.data.qpos[0] == 0
    assert physics.data.body("arm").xipos == pytest.approx([0.1, 0, 0.5]), "the limb points forwards"
    physics = Physics(arm(degrees=90, sign=-1))
    assert physics.data.body("arm").xipos == pytest.approx([0.1, 0, 0.5])


def test_servos_rest_at_the_limit_next_to_0() -> None:
    physics = Physics(arm(limits=[-60, -30]))
    assert physics.data.qpos[0] == pytest.approx(-0.5236, abs=1e-4)


def test_a_follower_copies_the_angle_of_the_servo() -> None:
    limbs = [{"id": f"limb{x}", "at": [x, 400, 0], "shapes": [LIMB]} for x in (0, 100)]
    physics = Physics(body(limbs[0] | {"servo": 1}, limbs[1] | {"follows": 1, "sign": -1}))
    physics.data.ctrl[0] = 0.5
    physics.advance(1000)
    one, other = physics.data.qpos
    assert one == pytest.approx(0.5, abs=0.1)
    assert other == pytest.approx(one, abs=0.02)


def test_names_cannot_break_the_model() -> None:
    names = ["", "world", "base", "floor", '<a b="c">&', "\x00", r"\x00", "\ud800", "手"]
    model = model_text(body(*({"id": name, "at": [0, 300 * at, 0], "shapes": [LIMB]} for at, name in enumerate(names))))
    assert mujoco().MjModel.from_xml_string(model).nbody == len(names) + 2


def test_parts_that_overlap_are_named() -> None:
    joints = [{"id": name, "at": [x, 400, 0], "shapes": [LIMB], "servo": x + 1} for name, x in (("a", 0), ("b", 12))]
    with pytest.raises(TwinError, match=r"'a' and 'b' overlap at rest by [48]\.0 mm; move their shapes apart"):
        Physics(body(*joints))
    assert Physics(body(*joints, body={"touching": [["b", "a"]]})).touching() == set()


def test_the_command_writes_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "robot.xml"
    said = call(capsys, "twin", "model", str(DEMO), "-o", str(out))
    assert (said.code, said.err) == (0, "")
    assert said.out.endswith("robot.xml: written, with 19 parts, 16 servos, 1.62 kg\n")
    assert mujoco().MjModel.from_xml_path(str(out)).nu == 16
    said = call(capsys, "twin", "model", str(DEMO), "-o", str(out))
    assert (said.code, "exists already; --force replaces it" in said.err) == (1, True)


def test_a_model_needs_no_mujoco_but_physics_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError(f"advice\n\nNo module named {name!r}\n")

    monkeypatch.setattr(simulation, "import_module", missing)
    monkeypatch.setattr(simulation, "find_spec", lambda name: None)
    assert call(capsys, "twin", "model", str(DEMO), "-o", str(tmp_path / "robot.xml")).code == 0
    with pytest.raises(
        TwinError, match=r"needs MuJoCo; in a copy .* pip install '\.\[twin\]' \(No module named 'mujoco'\)$"
    ):
        Physics(arm())
