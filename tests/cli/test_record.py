"""`servolink record` of a board of its own: the file, what is said, and how it ends."""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.cli.record_view import status_line
from servolink.recorder.reading import Recording
from servolink.recorder.writer import RecorderStatus
from tests.cli.programs import call


def test_a_recording_of_some_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "out.mcap"
    said = call(capsys, "record", str(path), "--seconds", "0.1", "--board", "virtual://")
    assert said.code == 0
    assert f"to {path}" in said.out
    with Recording(path) as recording:
        assert len(list(recording.entries())) > 5
        assert recording.remarks == []


def test_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "out.mcap"
    first, last = call(
        capsys, "record", str(path), "--seconds", "0.1", "--wire", "--json", "--board", "virtual://"
    ).objects
    assert first == {"recording": str(path)}
    assert last["path"] == str(path)
    assert last["dropped"] == 0
    assert last["size_bytes"] == path.stat().st_size


def test_a_file_that_exists_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "out.mcap"
    path.write_text("mine")
    said = call(capsys, "record", str(path), "--board", "virtual://")
    assert said.code == 1
    assert "exists already" in said.err
    assert path.read_text() == "mine"


def test_the_line_on_a_terminal_says_what_is_missing() -> None:
    status = RecorderStatus("out.mcap", 65.2, 300_000, 1234, 0, "")
    assert status_line(status, 80) == "1:05  1,234 messages  293 KiB  m: mark  q: end"
    bad = RecorderStatus("out.mcap", 65.2, 3_000_000, 1234, 7, "No space left on device")
    assert status_line(bad, 200) == (
        "1:05  1,234 messages  2.9 MiB  7 missing  nothing can be written: No space left on device  m: mark  q: end"
    )
    assert len(status_line(bad, 40)) == 40
