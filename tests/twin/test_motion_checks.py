"""Checks of motions from the pose in which the robot is: quick where poses say enough, simulated where not."""

from __future__ import annotations

import asyncio
import json
from contextlib import aclosing
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import pytest
from msgspec.structs import replace

from servolink.errors import TwinError
from servolink.project import BodyFields, Project, ProjectFile
from servolink.protocol import Action, Step
from servolink.twin import PhysicsProcess, Verdict, check_move, check_record
from servolink.twin.motion_checks import MotionVerdict
from servolink.twin.trial import RunningTrial
from tests.twin.figures import template

if TYPE_CHECKING:
    from collections.abc import Mapping

HUMANOID = template("humanoid-16").checked()
FIGURE = json.dumps(HUMANOID.to_json()).encode()
REST = dict.fromkeys(range(1, 17), 0.0)


def record(action: Action, pose: Mapping[int, float] = REST, figure: bytes = FIGURE) -> MotionVerdict:
    """Return the result for an action."""
    *parts, last = check_record(figure, Project(actions=(action,)), action, pose)
    assert all(part is True for part in parts)
    assert isinstance(last, MotionVerdict)
    return last


def test_a_movement_that_meets_nothing_is_not_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RunningTrial, "advance", lambda *_: pytest.fail("simulated"))
    basis: dict[str, str] = dict.fromkeys(("weight", "strength", "speed", "lag"), "assumed")
    assert next(check_move(FIGURE, REST, {1: 30}, 0.5)) == MotionVerdict(Verdict.STANDS, "", basis)


@pytest.mark.parametrize(
    ("targets", "seconds", "text"),
    [
        ({8: 60}, 1.0, "the robot falls after 1.5 s; servo 8 strains most"),
        ({7: -40}, 1.0, "after 0.3 s, l_foot and r_foot, turned by servo 7, press on each other with"),
        ({8: 60}, 0.1, "the robot falls after"),
    ],
)
def test_a_fall_and_a_hard_touch_are_told_with_moment_and_servo(
    targets: dict[int, float], seconds: float, text: str
) -> None:
    found = next(check_move(FIGURE, REST, targets, seconds))
    assert found.verdict is Verdict.FALLS
    assert found.text.startswith(text)


def test_a_record_is_tried_from_the_pose_in_which_the_robot_is() -> None:
    bend = Action(1, "Bend", (Step(8, 12, 100), Step(13, -12, 100)))
    assert record(bend).verdict is not Verdict.FALLS
    assert record(Action(2, "Bow", (Step(8, 80, 70), Step(13, -80, 70)))).text.startswith("the robot falls after")
    with pytest.raises(TwinError, match="does not stand where the robot is now"):
        record(bend, {**REST, 8: 80, 13: -80})


def test_a_bolted_robot_never_falls_and_is_checked_for_touches() -> None:
    body = HUMANOID.body or BodyFields()
    fields = replace(body, bolted=True, touching=(*body.touching, ("pelvis", "r_hip"), ("pelvis", "l_hip")))
    bolted = msgspec.json.encode(replace(HUMANOID, body=fields).to_json())
    assert next(check_move(bolted, REST, {8: 40}, 0.5)).verdict is Verdict.STANDS
    assert "press on each other" in next(check_move(bolted, REST, {7: -40}, 1.0)).text


def test_a_process_checks_movements_between_the_parts_of_a_record(tmp_path: Path) -> None:
    path = tmp_path / "robot.servolink.json"
    ProjectFile(Project(), figure=HUMANOID).write(path)
    process, bend = PhysicsProcess.checker(path), Action(1, "Bend", (Step(8, 5, 100),))

    async def main() -> None:
        async with aclosing(process.check_record(Project(actions=(bend,)), bend, REST)) as pieces:
            assert await anext(pieces) is True
            assert (await process.check_move(REST, {8: 60}, 1.0)).verdict is Verdict.FALLS
            assert isinstance([piece async for piece in pieces][-1], MotionVerdict)
        await process.close()

    asyncio.run(main())
