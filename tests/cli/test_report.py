"""`servolink report` on a virtual board whose names are secrets."""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.client.board import Board
from servolink.protocol.records import Action, ServoParameter, Step
from servolink.recorder.report import FACTS, PROJECT, RECORDING, read_report
from tests.cli.programs import call
from tests.cli.robot import Robot
from tests.recorder.test_replaying import WAVE
from tests.recorder.test_report import PRIVATE, in_it


@pytest.fixture
def robot_with_secrets(robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Robot:
    for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    monkeypatch.setattr("getpass.getuser", lambda: "zyx-anna")
    monkeypatch.setattr("socket.gethostname", lambda: "zyx-host")

    async def store(board: Board) -> None:
        await board.add_action(Action(1, PRIVATE, (Step(1, 30, 5),)))
        await board.add_servo_parameters([ServoParameter(1, 0, PRIVATE)])

    robot.ask(store)
    return robot


@pytest.mark.usefixtures("robot_with_secrets")
def test_report_of_a_board(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call(capsys, "use", "zyx-board", "virtual://")
    path = tmp_path / "report.zip"
    said = call(capsys, "--board", "zyx-board", "report", "--seconds", "1", "--yes", "-o", str(path))
    assert said.code == 0, said.err
    assert "not in it: captions, serial numbers, paths" in said.out
    facts, files = read_report(path)
    assert set(files) == {FACTS, RECORDING}
    assert facts["board"] == {"address": "virtual"}
    assert facts["stats"]["frames_received"] > 20
    assert facts["versions"].keys() >= {"servolink", "python", "msgspec"}
    assert facts["doctor"]["response"]["byte_order"] == "little"
    found = in_it(path.read_bytes(), tmp_path).lower()
    assert b"zyx" not in found
    assert str(Path.home()).encode() not in found or str(Path.home()) == "/"
    shown = call(capsys, "show", str(path))
    assert shown.code == 0
    assert "QueryServo" in shown.out
    assert call(capsys, "show", str(path), "--json").objects[0]["report"] == facts


@pytest.mark.usefixtures("robot_with_secrets")
def test_project_only_if_agreed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "report.zip"
    options = ("--seconds", "0", "--yes", "--json", "-o", str(path))
    said = call(capsys, "--board", "virtual://", "report", "--with-project", *options)
    assert said.json["contents"].keys() == {FACTS, PROJECT}
    assert PRIVATE.encode() in read_report(path)[1][PROJECT]
    assert "report.zip exists already; --force replaces it" in call(capsys, "-b", "virtual://", "report", *options).err
    call(capsys, "--board", "virtual://", "report", "--force", *options)
    assert read_report(path)[1].keys() == {FACTS}


@pytest.mark.usefixtures("robot_with_secrets")
def test_report_of_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "report.zip"
    options = ("--recording", str(WAVE), "--yes", "-o", str(path))
    assert call(capsys, "--board", "virtual://", "report", *options).code == 0
    assert b"Wave" not in in_it(path.read_bytes(), tmp_path)
    assert call(capsys, "--board", "virtual://", "report", "--with-project", *options, "--force").code == 2


def test_board_that_is_not_there_has_a_report_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "report.zip"
    said = call(capsys, "--board", "serial:///dev/zyx-1", "report", "--yes", "-o", str(path))
    assert said.code == 0
    facts, files = read_report(path)
    assert set(files) == {FACTS}
    assert "absent" in [finding["check"] for finding in facts["doctor"]["findings"]]
    assert b"zyx" not in files[FACTS]


def test_nothing_is_written_unasked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "report.zip"
    said = call(capsys, "--board", "virtual://", "report", "-o", str(path))
    assert said.code == 2
    assert "--yes goes on without asking" in said.err
    assert not path.exists()
