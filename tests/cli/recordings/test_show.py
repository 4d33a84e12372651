"""`servolink show` on recordings: text for people, JSON for programs, filters, cut files."""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.recorder import Event, Message, PacketSeen, ServosRead
from tests.cli.programs import call
from tests.cli.terminals import ESCAPE, in_terminal
from tests.recorder.files import ABOUT, write
from tests.recorder.test_reading import MESSAGES


@pytest.fixture
def recording(tmp_path: Path) -> str:
    return str(write(tmp_path / "out.mcap", MESSAGES))


def test_story(recording: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "show", recording)
    assert (said.code, said.err) == (0, "")
    assert "board       rex, beside other programs on its hub\n" in said.out
    assert "     0.700  studio      SetAngleUnit servo_id=3 unit_type=0, answered in 200 ms\n" in said.out
    assert "commands of unknown outcome (1)" in said.out


def test_problems_only(recording: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "show", recording, "--problems")
    assert "SetAngleUnit servo_id=3" not in said.out
    assert "OUTCOME UNKNOWN" in said.out


def test_json(recording: str, capsys: pytest.CaptureFixture[str]) -> None:
    first, *messages, last = call(capsys, "show", recording, "--json", "--channel", "commands", "--to", "0.75").objects
    assert first["recording"]["board"] == "rex"
    assert [(each["seconds"], each["channel"], each["message"]["outcome"]) for each in messages] == [
        (0.7, "/commands", "answered")
    ]
    assert last["summary"]["messages"] == {"/commands": 1}


def test_bytes_are_base64_in_json(recording: str, capsys: pytest.CaptureFixture[str]) -> None:
    _, wire, _ = call(capsys, "show", recording, "--json", "--channel", "wire").objects
    assert wire["message"]["data"] == "E0w="


def test_packet_is_told_with_its_response(recording: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "show", recording, "--packet", "SetAngleUnit")
    assert "line        SetAngleUnit servo_id=3 unit_type=0, NOT ANSWERED" in said.out


@pytest.mark.parametrize("options", [("--servo", "3"), ("--servo", "99"), ("--to", "0.1"), ("--packet", "QueryServo")])
def test_selection_invents_no_failure(
    options: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages: list[tuple[float, Message]] = [
        (0.0, PacketSeen("sent", 20020, "QueryServoRequest", {"servo_id": 255})),
        (0.2, PacketSeen("received", 20021, "QueryServoResponse", {"servos": [{"servo_id": 1}]})),
        (1.0, PacketSeen("sent", 30110, "AddServoParameterRequest", {"servos": [{"servo_id": 3}]})),
        (1.1, PacketSeen("received", 30111, "AddServoParameterResponse", {"result": 1})),
    ]
    said = call(capsys, "show", str(write(tmp_path / "x.mcap", messages)), *options)
    assert "problems  none" in said.out


def test_other_packets_break_a_silence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lost = PacketSeen("sent", 20020, "QueryServoRequest", {"servo_id": 3})
    other = PacketSeen("received", 20011, "QueryServoListResponse", {"servo_id_list": [3]})
    path = str(write(tmp_path / "x.mcap", [(0.0, lost), (0.9, other), (1.8, other), (2.7, other), (2.8, lost)]))
    assert "nothing came" not in call(capsys, "show", path, "--servo", "3").out


def test_cut_file_is_shown_with_a_remark(recording: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = Path(recording)
    path.write_bytes(path.read_bytes()[:-400])
    said = call(capsys, "show", recording)
    assert said.code == 0
    assert "the file is cut, and its end is missing: `servolink record --repair" in said.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--packet", "QuerServo"), "no packet is called 'QuerServo'; did you mean QueryServo"),
        (("--from", "3", "--to", "2"), "--from 3 is after --to 2"),
        (("--channel", "sound"), "must be wire or packets"),
    ],
)
def test_wrong_options(
    options: tuple[str, str], message: str, recording: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = call(capsys, "show", recording, *options)
    assert said.code == 2
    assert message in said.err


def test_other_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.json"
    path.write_text("{}")
    said = call(capsys, "show", str(path))
    assert (said.code, said.out) == (1, "")
    assert "x.json is not an MCAP file" in said.err


def test_terminal_wraps_lines_between_words(recording: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.cli.terminals._COLUMNS", 72)
    monkeypatch.chdir(Path(recording).parent)
    said = in_terminal("show", "out.mcap")
    lines = ESCAPE.sub("", said.out).split("\n")
    assert max(map(len, lines)) <= 72
    at = next(number for number, line in enumerate(lines) if "ExecuteAction" in line)
    assert lines[at + 1].startswith(" " * 24)


def test_names_are_cut_to_the_column(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "x.mcap", [(0.0, Event("lease", "taken", "\u5927\u5b57" * 9))])
    assert "  \u5927\u5b57\u5927\u5b57\u5927  lease taken" in call(capsys, "show", str(path)).out


@pytest.mark.parametrize("hz", ["20", "nonsense"])
def test_rate_that_nobody_understands_is_none(hz: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    readings: list[tuple[float, Message]] = [(0.0, ServosRead(())), (9.0, ServosRead(()))]
    path = write(tmp_path / "x.mcap", readings, about={**ABOUT, "hz": hz})
    said = call(capsys, "show", str(path))
    assert ("no reading of the servos in the last 9.0 s" in said.out) == (hz == "20")
