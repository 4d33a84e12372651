"""`servolink servo`: servos are started, held, released, named and trimmed."""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.project import BackupStore
from servolink.protocol import ServoParameter
from tests.cli.robot import Robot


@pytest.fixture(autouse=True)
def _own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))


def states(robot: Robot) -> list[tuple[bool, bool]]:
    return [(bool(servo.is_start), bool(servo.is_hold)) for servo in robot.board.servos.values()]


def parameters(robot: Robot) -> tuple[ServoParameter, ...]:
    found = robot.ask(lambda board: board.servo_parameters())
    return tuple(one for one in found if one.adjusted_degree or one.servo_caption)


def test_servos_are_started_held_and_released(robot: Robot) -> None:
    assert robot("servo", "release", "--yes").code == 0
    assert states(robot) == [(False, False)] * 3
    assert robot("servo", "start", "1", "2").code == 0
    assert states(robot) == [(True, True), (True, True), (False, False)]
    said = robot("servo", "hold", "all", "--json")
    assert [(servo["is_start"], servo["is_hold"]) for servo in said.json["servos"]] == [(False, True)] * 3
    assert states(robot) == [(False, True)] * 3
    assert robot("servo", "list").out == robot("servos").out


def test_a_servo_is_trimmed_and_named_and_the_rest_stays(robot: Robot) -> None:
    robot.ask(lambda board: board.add_servo_parameters([ServoParameter(2, 7, "knee")]))
    said = robot("servo", "trim", "3", "+4")
    assert (said.code, said.err) == (0, "")
    assert said.out.startswith("+ servo parameter 3 ")
    assert parameters(robot) == (ServoParameter(2, 7, "knee"), ServoParameter(3, 4))
    assert robot("servo", "rename", "3", "hip").code == 0
    assert robot("servo", "rename", "1", "toe").out.startswith("~ servo parameter 1 'toe'\n    caption '' -> 'toe'\n")
    assert robot("servo", "rename", "1", "").code == 0
    assert robot("servo", "trim", "hip", "-2").code == 0
    assert parameters(robot) == (ServoParameter(2, 7, "knee"), ServoParameter(3, -2, "hip"))
    assert "nothing to change" in robot("servo", "trim", "hip", "-2").out
    assert robot("servo", "trim", "3", "0").code == 0
    assert len(BackupStore().backups()) == 6
    assert robot("rollback", "--yes").code == 0
    assert parameters(robot)[1].adjusted_degree == -2


@pytest.mark.parametrize(("caption", "said"), [("all", True), ("7", True), ("name:x", True), ("All", False)])
def test_a_caption_that_means_something_else_alone_is_said(caption: str, said: bool, robot: Robot) -> None:
    hint = f"servolink: in commands, the caption '{caption}' is written name:{caption}\n"
    renamed = robot("servo", "rename", "1", caption)
    assert (renamed.code, renamed.err) == (0, hint if said else "")
    assert robot("servo", "rename", f"name:{caption}", "hip").err == ""


def test_units_are_set(robot: Robot) -> None:
    assert robot("servo", "unit", "1", "2", "adc").out == "servo 1, servo 2: angles are in raw ADC readings\n"
    assert robot("servo", "unit", "all", "degree", "--json").json == {"servo_ids": [255], "angle_unit": "degree"}
    assert robot("servo", "unit", "1", "radian").code == 2


@pytest.mark.parametrize(
    ("command", "code", "why"),
    [
        ("servo start 1 99", 1, "the board has no servo 99; no servo was changed"),
        ("servo start hip", 1, "the board has no servo 'hip'"),
        ("servo start", 2, "SERVO"),
        ("servo start 256", 2, "must be an integer from 0 to 254, not '256'"),
        ("servo unit 99 adc", 1, "the board has no servo 99"),
        ("servo trim 99 3", 1, "the board has no servo 99"),
        ("servo trim all 3", 1, "the board has no servo 255"),
        ("servo trim 1 181", 2, "must be an integer from -180 to 180, not '181'"),
        ("servo rename 1 123456789012345678901234567890123", 1, "a caption has at most 32 bytes"),
        ("servo release 1", 2, "raised limbs fall; add --yes if they may"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(command: str, code: int, why: str, robot: Robot) -> None:
    before = states(robot)
    said = robot(*command.split())
    assert (said.code, said.out) == (code, "")
    assert why in said.err
    assert (states(robot), parameters(robot)) == (before, ())
