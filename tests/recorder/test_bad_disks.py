"""A disk that is slow or full: what is lost, that the file says so, and that nobody waits.

Modules: servolink.recorder.backlog, servolink.recorder.writer.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from servolink.errors import RecordingError
from servolink.recorder.backlog import Backlog
from servolink.recorder.channels import (
    WIRE_ONLY,
    Event,
    Message,
    ProblemFound,
    Recorded,
    RecordedServo,
    ServosRead,
    Wire,
)
from servolink.recorder.clock import Clock
from servolink.recorder.reading import Recording
from servolink.recorder.recording_file import RecordingFile
from servolink.recorder.writer import RecordingWriter
from tests.recorder.bad_disk import BadDisk

ABOUT = Recorded("0", "2026-11-22T16:00:00Z", "rex", "board", channels=WIRE_ONLY)
SERVOS = ServosRead((RecordedServo(1, 90, "degree", 3, 40, 1, is_start=True, is_hold=True),) * 16)


def read(path: Path) -> list[Message]:
    recording = Recording(path)
    found = [entry.message for entry in recording.entries()]
    assert recording.remarks == []
    return found


def test_a_file_has_only_whole_blocks(tmp_path: Path) -> None:
    disk = BadDisk(room=25, piece=7)
    file = RecordingFile(tmp_path / "file", disk=disk)
    assert file.put(b"a" * 10)
    assert file.put(b"b" * 10)
    assert not file.put(b"c" * 10)
    assert file.problem == "No space left on device"
    assert (tmp_path / "file").read_bytes() == b"a" * 10 + b"b" * 10
    assert not file.put(b"d" * 10)
    disk.room = 100
    assert file.retry()
    assert file.problem == ""
    file.close()
    file.close()
    assert (tmp_path / "file").read_bytes() == b"".join(letter * 10 for letter in (b"a", b"b", b"c", b"d"))
    assert file.size == 40


def test_a_slow_disk_costs_readings_first_and_the_file_says_so(tmp_path: Path) -> None:
    path, disk, backlog = tmp_path / "out.mcap", BadDisk(), Backlog(20_000, 200_000)
    clock = Clock()
    writer = RecordingWriter(path, ABOUT, clock, backlog=backlog, disk=disk)
    disk.may_write.clear()
    # The writer stands still with a full chunk, as long as a test needs.
    writer.take(clock.now(), Wire("sent", bytes(300_000), 0.0))
    assert disk.is_waiting.wait(60)
    for number in range(100):
        writer.take(clock.now(), Wire("received", bytes(1000), float(number)))
        writer.take(clock.now(), SERVOS)
    assert backlog.size < 200_000
    disk.may_write.set()
    writer.close()
    found = read(path)
    assert sum(isinstance(each, Wire) for each in found) == 101
    missing = [each for each in found if isinstance(each, ProblemFound)]
    assert {each.channel for each in missing} == {"/servos"}
    assert sum(each.count for each in missing) == 100 - sum(isinstance(each, ServosRead) for each in found) > 50
    assert writer.status().dropped == sum(each.count for each in missing)


def test_at_the_bound_bytes_are_lost_too_and_the_file_says_where(tmp_path: Path) -> None:
    path, disk, backlog = tmp_path / "out.mcap", BadDisk(), Backlog(20_000, 50_000)
    clock = Clock()
    writer = RecordingWriter(path, ABOUT, clock, backlog=backlog, disk=disk)
    disk.may_write.clear()
    writer.take(clock.now(), Wire("sent", bytes(300_000), 0.0))
    assert disk.is_waiting.wait(60)
    for number in range(100):
        writer.take(clock.now(), Wire("received", b"\x13\x4c" + bytes(998), float(number)))
    assert backlog.size <= 52_000
    disk.may_write.set()
    writer.close()
    found = read(path)
    (missing,) = [each for each in found if isinstance(each, ProblemFound)]
    assert missing.channel == "/wire"
    assert missing.count == 101 - sum(isinstance(each, Wire) for each in found) > 50
    assert "the disk is too slow" in missing.text


def test_when_a_full_disk_has_room_again_it_goes_on(tmp_path: Path) -> None:
    path, disk = tmp_path / "out.mcap", BadDisk(room=8000)
    clock = Clock()
    writer = RecordingWriter(path, ABOUT, clock, disk=disk)
    for number in range(20):
        writer.take(clock.now(), Wire("received", bytes(100_000), float(number)))
    disk.room = 10**9
    writer.take(clock.now(), Event("mark", "last"))
    writer.close()
    assert sum(isinstance(each, Wire) for each in read(path)) == 20


def test_a_full_disk_leaves_what_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("servolink.recorder.writer._PATIENCE", 0.0)
    path, disk = tmp_path / "out.mcap", BadDisk(room=9000)
    clock = Clock()
    writer = RecordingWriter(path, ABOUT, clock, disk=disk)
    writer.take(clock.now(), Event("mark", "first"))
    writer.take(clock.now(), Wire("received", bytes(300_000), 0.0))
    for _ in range(40):
        writer.take(clock.now(), Wire("received", os.urandom(10_000), 0.0))
    with pytest.raises(RecordingError, match="is not complete: No space left on device"):
        writer.close()
    recording = Recording(path)
    assert next(recording.entries()).message == Event("mark", "first")
    assert list(recording.entries()) is not None
    assert "its end is missing" in recording.remarks[-1]


def test_a_disk_that_is_full_from_the_beginning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("servolink.recorder.writer._PATIENCE", 0.0)
    writer = RecordingWriter(tmp_path / "out.mcap", ABOUT, Clock(), disk=BadDisk(room=0))
    assert writer.status().problem == "No space left on device"
    with pytest.raises(RecordingError, match="No space left on device"):
        writer.close()
