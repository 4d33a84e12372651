"""`servolink request`: any request of the protocol, with the limits, questions and backups of the other commands."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from servolink.project import UNFINISHED, BackupStore, Project
from servolink.protocol import PACKETS, Action, Command, JoystickTable, Macro, Packet, Request, Step
from tests.cli.robot import Robot

STORED = Project(77, (), (Action(1, "Bow", (Step(1, 80, 50),)),), (Macro(1, "Rest"),), (JoystickTable(1, "Pad"),), 1)
SENT = [packet for packet in PACKETS.values() if issubclass(packet, Request | Command)]


@pytest.fixture(name="robot")
def _robot(robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Robot:
    for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    robot.ask(lambda board: board.apply_project(STORED, backup=False))
    return robot


@pytest.mark.parametrize("packet", SENT, ids=lambda packet: packet.__name__)
def test_every_request_is_sent_and_its_response_printed(packet: type[Packet], robot: Robot) -> None:
    values = {"servo_id": 1, "action_id": 1, "macro_id": 1, "table_id": 1, "data": "00ff", "steps": [], "is_hold": 1}
    lists = {"commands", "buttons", "servos"}
    fields = {
        name: [] if name in lists else values.get(name, "x" if name.endswith("caption") else 1)
        for name in packet.__struct_fields__
    }
    said = robot("request", json.dumps({packet.__name__: fields}), "--yes", "--json")
    assert said.code == 0, said
    if issubclass(packet, Command):
        assert said.json == {"sent": packet.__name__}
    else:
        assert said.json["packet"] == packet.__name__.replace("Request", "Response")
        assert said.json["fields"]


def test_a_response_is_printed_as_decode_does(robot: Robot) -> None:
    said = robot("request", '{"QueryActionRequest": {"action_id": 1}}')
    lines = said.out.splitlines()
    assert lines[0].startswith("QueryActionResponse (")
    assert "action_caption='Bow'" in lines[0]
    assert lines[1] == "    servo_id=1 degree=80 interval=50"
    form = '{"packet": "QueryActionRequest", "fields": {"action_id": 1}}'
    assert robot("request", form).out == said.out


def test_what_deletes_asks_and_makes_a_backup(robot: Robot) -> None:
    delete = '{"DeleteActionRequest": {"action_id": 1}}'
    refused = robot("request", delete)
    assert (refused.code, refused.out) == (2, "")
    assert "this deletes a record from the board; --yes does so without asking" in refused.err
    assert "everything stored" in robot("request", '{"ClearAllDataRequest": {}}').err
    assert (
        "raised limbs fall"
        in robot("request", '{"SetServoParameterRequest":{"servo_id":1,"is_start":0,"is_hold":0}}').err
    )
    said = robot("request", delete, "--yes")
    assert said.code == 0
    [backup] = BackupStore().backups()
    assert BackupStore().load(backup.path) == STORED
    assert f"`servolink rollback {backup.number}` restores it" in said.err
    assert robot("request", delete, "--yes", "--no-backup").code == 1, "the board refuses it"
    assert len(BackupStore().backups()) == 1
    assert robot("rollback", str(backup.number), "--yes").code == 0
    assert robot.ask(lambda board: board.export_project()) == STORED


def test_limits_hold(robot: Robot) -> None:
    move = '{"ExecuteActionRequest": {"steps": [{"servo_id": 1, "degree": 80, "interval": 100}]}}'
    for request in (move, '{"ExecuteActionExRequest": {"action_id": 1}}'):
        said = robot("request", request, "--limit", "0", "50")
        assert (said.code, said.out) == (1, "")
        assert "its limits are 0..50" in said.err or "outside" in said.err
    assert robot.board.servos[1].angle < 50
    assert robot("request", move).out == "ExecuteActionRequest was sent; boards do not answer it\n"


def test_ids_that_mark_an_unfinished_import_are_refused(robot: Robot) -> None:
    said = robot("request", json.dumps({"WriteProjectIDRequest": {"project_id": UNFINISHED[0]}}))
    assert said.code == 1
    assert "is reserved" in said.err


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ("{", "servolink: the packet is not JSON"),
        ("3", "must be an object with packet and fields, not 3"),
        ('{"QueryServoRequest": {"servo_id": 300}}', "QueryServoRequest.servo_id"),
        ('{"QueryServoRequest": 3}', "must be an object, not 3"),
        ('{"QueryServo": {}}', "packet: there is no 'QueryServo'; did you mean QueryServoRequest?"),
        ('{"packet": "QueryServo"}', "packet: there is no 'QueryServo'; did you mean QueryServoRequest?"),
        ('{"Fly": 3}', "packet: there is no 'Fly'\n"),
        ("{}", "the object has neither packet nor id"),
        ('{"QueryServoResponse": {"servos": []}}', "QueryServoResponse comes from a board; give a request"),
    ],
)
def test_what_is_not_a_request_is_refused(given: str, why: str, robot: Robot) -> None:
    said = robot("request", given)
    assert (said.code, said.out) == (1, "")
    assert why in said.err
