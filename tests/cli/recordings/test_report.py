"""`servolink report` on a virtual board whose names are secrets."""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.client import Board
from servolink.errors import ConnectionLost
from servolink.protocol import Action, ServoParameter, Step
from servolink.recorder import BugReport
from tests.cli.programs import call
from tests.cli.robot import Robot
from tests.cli.terminals import in_terminal
from tests.recorder.test_bug_report import PRIVATE, in_it
from tests.recorder.test_replaying import WAVE
from tests.transports.listed_ports import listed, port


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
    report = BugReport.read(path)
    facts, files = report.facts, report.files
    assert set(files) == {BugReport.FACTS, BugReport.RECORDING}
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
    assert said.json["contents"].keys() == {BugReport.FACTS, BugReport.PROJECT}
    assert PRIVATE.encode() in BugReport.read(path).files[BugReport.PROJECT]
    assert "report.zip exists already; --force replaces it" in call(capsys, "-b", "virtual://", "report", *options).err
    call(capsys, "--board", "virtual://", "report", "--force", *options)
    assert BugReport.read(path).files.keys() == {BugReport.FACTS}


@pytest.mark.usefixtures("robot_with_secrets")
def test_report_of_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "report.zip"
    options = ("--recording", str(WAVE), "--yes", "-o", str(path))
    assert call(capsys, "--board", "virtual://", "report", *options).code == 0
    assert b"Wave" not in in_it(path.read_bytes(), tmp_path)
    assert call(capsys, "--board", "virtual://", "report", "--with-project", *options, "--force").code == 2


def test_the_recording_is_never_replaced_by_its_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "wave.mcap"
    path.write_bytes(WAVE.read_bytes())
    options = ("--recording", str(path), "-o", str(path), "--force", "--yes")
    said = call(capsys, "--board", "virtual://", "report", *options)
    assert said.code == 2
    assert "is the file that is read, and would be lost; choose another name with --output" in said.err
    assert path.read_bytes() == WAVE.read_bytes()


def test_board_that_is_not_there_has_a_report_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "report.zip"
    said = call(capsys, "--board", "serial:///dev/zyx-1", "report", "--yes", "-o", str(path))
    assert said.code == 0
    report = BugReport.read(path)
    facts, files = report.facts, report.files
    assert set(files) == {BugReport.FACTS}
    assert "absent" in [finding["check"] for finding in facts["doctor"]["findings"]]
    assert b"zyx" not in files[BugReport.FACTS]


def test_nothing_is_written_unasked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "report.zip"
    said = call(capsys, "--board", "virtual://", "report", "-o", str(path))
    assert said.code == 2
    assert "--yes continues without asking" in said.err
    assert not path.exists()


@pytest.mark.parametrize(("answer", "code"), [("y", 0), ("n", 1)])
def test_it_asks_in_a_terminal(answer: str, code: int, tmp_path: Path) -> None:
    path = tmp_path / "report.zip"
    said = in_terminal("--board", "virtual://", "report", "--seconds", "0", "-o", str(path), typed=f"{answer}\n")
    assert said.code == code
    assert f"write {path}? [y/N]" in said.out
    assert path.exists() == (code == 0)


def test_board_that_fails_meanwhile_has_a_report_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def lost(*_: object, **__: object) -> None:
        raise ConnectionLost(f"/dev/{PRIVATE} was unplugged after 3 s")

    monkeypatch.setattr("servolink.cli.recordings.report.record", lost)
    path = tmp_path / "report.zip"
    assert call(capsys, "--board", "virtual://", "report", "--yes", "-o", str(path)).code == 0
    facts = BugReport.read(path).facts
    assert facts["trouble"] == "*** was unplugged after 3 s"


@pytest.mark.usefixtures("robot_with_secrets")
def test_profile_is_in_it_without_what_tells_the_board_from_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call(capsys, "use", "zyx-board", "virtual://")
    call(capsys, "board", "set", "zyx-board", "--depth", "4", "--angle", "3=0..9")
    path = tmp_path / "report.zip"
    call(capsys, "--board", "zyx-board", "report", "--seconds", "0", "--yes", "-o", str(path))
    report = BugReport.read(path)
    facts, files = report.facts, report.files
    assert facts["profile"]["settings"]["depth"] == 4
    assert facts["profile"].keys() == {"settings", "limits"}
    assert b"zyx" not in files[BugReport.FACTS].lower()


def test_devices_here_are_named_by_their_kind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    listed(monkeypatch, port("/dev/zyx-1", 0x1A86, "Zyx", "ZYX99", pid=0x7523))
    path = tmp_path / "report.zip"
    call(capsys, "--board", "virtual://", "report", "--seconds", "0", "--yes", "-o", str(path))
    report = BugReport.read(path)
    facts, files = report.facts, report.files
    assert facts["doctor"]["devices"] == [{"address": "serial", "usb": "1a86:7523"}]
    assert b"zyx" not in files[BugReport.FACTS].lower()


def test_a_file_that_cannot_be_written_is_said_before_anything_is_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "report.zip"
    path.write_bytes(b"mine")
    missing = tmp_path / "missing" / "report.zip"
    for out, why in ((path, "exists already; --force replaces it"), (missing, "the folder does not exist")):
        said = call(capsys, "--board", "virtual://", "report", "--seconds", "300", "--yes", "-o", str(out))
        assert (said.code, said.out) == (1, "")
        assert said.err.startswith(f"servolink: {out} ")
        assert why in said.err
    assert path.read_bytes() == b"mine"
