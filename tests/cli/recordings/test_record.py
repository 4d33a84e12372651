"""`servolink record` of a board of its own: the file, what is said, and how it ends.

Module: servolink.cli.recordings.record_view.
"""

from __future__ import annotations

import os
import re
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from servolink.cli import command_session
from servolink.cli.command_session import Interruption
from servolink.cli.recordings.record_view import RecordView, status_line, summary
from servolink.recorder import Recorder, RecorderStatus, Recording, Saved
from tests.cli.programs import call


def test_a_recording_of_some_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "out.mcap"
    said = call(capsys, "record", str(path), "--seconds", "0.1", "--board", "virtual://")
    assert said.code == 0
    assert f"to {path}" in said.out
    recording = Recording(path)
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


def test_a_ring_says_what_it_wrote(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "out.mcap"
    arguments = ("record", str(path), "--seconds", "0.1", "--ring", "5m", "--board", "virtual://")
    said = call(capsys, *arguments)
    assert (said.code, said.out) == (0, "nothing failed, and nothing was written\n")
    assert "keeping the last 300 s" in said.err
    said = call(capsys, *arguments, "--alarm", "temperature_raw>1")
    assert said.code == 0
    (written,) = tmp_path.iterdir()
    assert said.out.startswith(f"wrote {written}: servo ")
    said = call(capsys, *arguments, "--alarm", "temperature_raw>1", "--json")
    assert [min(each) for each in said.objects] == ["recording", "reason", "dropped"]


@pytest.mark.parametrize(
    ("time", "range_of"), [("25h", "1 to 24 hours"), ("1441m", "1 to 1440 minutes"), ("0", "1 to 86400 seconds")]
)
def test_a_ring_keeps_a_day_at_most(capsys: pytest.CaptureFixture[str], time: str, range_of: str) -> None:
    said = call(capsys, "record", "out.mcap", "--ring", time, "--board", "virtual://")
    assert said.code == 2
    assert f"must be from {range_of}, not" in said.err


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGUSR1")
def test_a_ring_is_written_for_a_signal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def run(view: RecordView) -> None:
        os.kill(os.getpid(), signal.SIGUSR1)

    monkeypatch.setattr(RecordView, "run", run)
    said = call(capsys, "record", str(tmp_path / "o.mcap"), "--seconds", "0.1", "--ring", "60", "--board", "virtual://")
    (written,) = tmp_path.iterdir()
    assert said.out == (
        f"wrote {written}: asked for by a signal\n"
        f"wrote {written}; nothing has failed since, and what came since was not kept\n"
    )


def test_the_end_of_a_ring_names_the_last_file() -> None:
    files = tuple(Saved(f"out-{number}.mcap", "stopped", 99) for number in (1, 2, 3))
    status = RecorderStatus("out.mcap", 65.2, 300_000, 1234, 0, "", saved=files)
    assert summary(status, is_ring=True) == (
        "wrote 3 files, the last one out-3.mcap; nothing has failed since, and what came since was not kept"
    )


@pytest.mark.skipif(sys.platform == "win32", reason="signals are those of Unix")
@pytest.mark.parametrize(
    ("option", "state"),
    [
        (
            (),
            r"recorded \d+ messages? in \d+\.\d s to (.+); its end may be missing, and `servolink record \1 --repair`",
        ),
        (("--ring", "60"), "nothing failed, and nothing was written; a failure of the last seconds may not be written"),
    ],
)
def test_a_second_ctrl_c_says_what_was_recorded_so_far(
    option: Sequence[str],
    state: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ends: list[str] = []

    async def run(view: RecordView) -> None:
        signal.raise_signal(signal.SIGINT)

    def report(interruption: Interruption) -> None:
        ends.append(interruption.state)

    async def end(recorder: Recorder) -> None:
        signal.raise_signal(signal.SIGINT)
        await ending(recorder)

    ending = Recorder.end
    monkeypatch.setattr(RecordView, "run", run)
    monkeypatch.setattr(Recorder, "end", end)
    monkeypatch.setattr(Interruption, "end", report)
    monkeypatch.setattr(command_session, "end_process", lambda code: None)  # on a busy machine it would end the tests
    said = call(capsys, "record", str(tmp_path / "out.mcap"), *option, "--board", "virtual://")
    (said_then,) = ends
    assert re.match(state, said_then), said_then
    assert said.code == 0


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
    assert status_line(status, 40) == "1:05  1,234 messages  293 KiB"  # never half of a key
    assert status_line(status, 80, is_ring=True) == "1:05 in memory  1,234 messages  293 KiB  m: mark  w: write  q: end"
