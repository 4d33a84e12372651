"""Forecasts: verdicts over variations of the body, on the command line too, and the demo project, which stands.

Module: servolink.twin.forecasts, servolink.twin.picture, servolink.cli.projects.twin.
"""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from servolink.errors import TwinError
from servolink.project import BodyFields, Project, ProjectFile, save_project
from servolink.protocol import Action, Macro, MacroCommand, Step
from servolink.twin import forecasts as module
from servolink.twin import picture
from servolink.twin.body import Body
from servolink.twin.forecasts import VARIATIONS, Verdict, forecast
from servolink.twin.moment import AFTER
from servolink.twin.picture import png
from servolink.twin.simulation import Physics
from servolink.twin.trial import Variation, run_trial
from tests.cli.programs import call
from tests.twin.figures import DEMO, template

FIGURE = template("humanoid-16")
HUMANOID = Body.of(FIGURE)
STAND = Action(1, "Stand", (Step(8, 0, 20), Step(13, 0, 20)))


def bow(degrees: int) -> Action:
    return Action(2, "Bow", (Step(8, degrees, 60), Step(13, -degrees, 60)))


def verdicts(degrees: int, step: float = 0.005) -> Verdict:
    (found,) = forecast(Project(actions=(bow(degrees),)), HUMANOID, [bow(degrees)], step=step)
    return found.verdict


def demo(mass: float) -> tuple[Project, Body]:
    """Return the demo project, and its body with servos that do not grow with the mass."""
    file = ProjectFile.read(DEMO)
    assert file.figure is not None
    fields = replace(file.figure.body or BodyFields(), mass=mass, torque=1.9)
    return file.project, Body.of(replace(file.figure, body=fields))


def test_a_bow_stands_or_falls_or_is_uncertain_by_its_depth() -> None:
    found = [verdicts(degrees) for degrees in (20, 28, 80)]
    assert found == [Verdict.STANDS, Verdict.UNCERTAIN, Verdict.FALLS]


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.001, 0.002])
def test_the_verdict_is_that_of_smaller_steps(step: float) -> None:
    assert [verdicts(degrees, step) for degrees in (20, 28, 80)] == ["stands", "uncertain", "falls"]
    project, body = demo(1.6)
    assert {one.verdict for one in forecast(project, body, project.macros, step=step)} == {Verdict.STANDS}


def test_variations_are_all_corners() -> None:
    assert VARIATIONS[0] == Variation()
    assert len(set(VARIATIONS)) == 9
    assert Variation(0.8, 1.2, 0.8) in VARIATIONS


@pytest.mark.parametrize("mass", [1.0, 2.5])
def test_the_macros_of_the_demo_project_stand(mass: float) -> None:
    project, body = demo(mass)
    physics = Physics(body, 0.005)
    assert [macro.macro_caption for macro in project.macros if run_trial(physics, project, macro).fall] == []


@pytest.mark.slow
@pytest.mark.parametrize("mass", [1.0, 1.6, 2.5])
def test_all_of_the_demo_project_stands_with_all_variations(mass: float) -> None:
    project, body = demo(mass)
    found = forecast(project, body, (*project.actions, *project.macros), processes=2)
    assert [one.record for one in found if one.verdict is not Verdict.STANDS] == []


@pytest.mark.slow
def test_processes_find_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_WORTH_PROCESSES", 0.0)
    project = Project(actions=(STAND, bow(28)))
    alone = forecast(project, HUMANOID, project.actions)
    assert forecast(project, HUMANOID, project.actions, processes=2) == alone


def written(tmp_path: Path, *actions: Action) -> str:
    macros = tuple(Macro(one.action_id, one.action_caption, (MacroCommand(one.action_id),)) for one in actions)
    save_project(tmp_path / "robot.json", Project(actions=actions, macros=macros), figure=FIGURE)
    return str(tmp_path / "robot.json")


def test_the_command_prints_verdicts_and_assumptions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "twin", "check", written(tmp_path, STAND, bow(80)))
    assert (said.code, said.err) == (1, "")
    assert "macro 1  Stand  stands   0°    38 mm" in said.out
    assert "macro 2 'Bow' falls: at 0.7 s, after the end" in said.out
    assert "assumed, as the figure does not say: mass of 1.62 kg, by the sizes of the parts; torque of " in said.out
    said = call(capsys, "twin", "check", written(tmp_path, STAND, bow(80)), "--macro", "macro:1")
    assert (said.code, "Bow" in said.out) == (0, False)


def test_the_command_prints_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "twin", "check", written(tmp_path, bow(80)), "--all", "--json")
    found = json.loads(said.out)
    assert (said.code, found["ok"], len(found["assumptions"])) == (1, False, 5)
    action, macro = found["forecasts"]
    assert (action["type"], macro["type"], macro["id"], macro["caption"]) == ("action", "macro", 2, "Bow")
    assert (macro["verdict"], macro["fall"]["step"]) == ("falls", AFTER)
    assert set(macro["torque"]) == set(macro["lag"]) == {str(servo_id) for servo_id in range(1, 17)}


def test_a_project_without_macros_has_nothing_to_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_project(tmp_path / "robot.json", Project(), figure=FIGURE)
    said = call(capsys, "twin", "check", str(tmp_path / "robot.json"))
    assert (said.code, said.out) == (0, "there is no macro to check; --all checks actions\n")


def test_a_picture_is_a_png() -> None:
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    content = png(pixels)
    assert content.startswith(b"\x89PNG\r\n\x1a\n")
    assert struct.unpack(">II", content[16:24]) == (4, 2)
    length = struct.unpack(">I", content[33:37])[0]
    rows = zlib.decompress(content[41 : 41 + length])
    assert rows == b"\0" + pixels[0].tobytes() + b"\0" + pixels[1].tobytes()


@pytest.mark.slow
def test_the_command_draws_the_fall_or_says_why_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "fall.png"
    said = call(capsys, "twin", "check", written(tmp_path, bow(80)), "--picture", str(out))
    assert said.code == 1
    if out.exists():
        assert out.read_bytes().startswith(b"\x89PNG")
        assert f"{out}: written, macro 2 'Bow' at 0.7 s" in said.out
    else:
        assert "nothing was drawn, as this computer has neither EGL nor OSMesa" in said.err


@pytest.mark.slow
def test_a_computer_that_cannot_draw_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(picture, "_WAYS", ("nonsense",))
    with pytest.raises(TwinError, match=r"nothing was drawn.*nonsense: .*apt install libegl1 libosmesa6"):
        picture.draw(Project(actions=(STAND,)), HUMANOID, STAND, Variation(), 0.1)
