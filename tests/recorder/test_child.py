"""The process that writes a recording for a program: what it says, and what is left if either of both is killed."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import msgspec
import pytest

from servolink.errors import RecordingError
from servolink.recorder.channels import WIRE_ONLY, Event, Recorded, Wire
from servolink.recorder.child import LENGTH, ChildWriter, Order
from servolink.recorder.clock import Clock
from servolink.recorder.mcap_reader import MAGIC
from servolink.recorder.reading import Recording
from tests import processes

ABOUT = Recorded("0", "2026-11-22T16:00:00Z", "rex", "board", channels=WIRE_ONLY)


def test_it_writes_all_and_says_how_much(tmp_path: Path) -> None:
    path, clock = tmp_path / "out.mcap", Clock()
    writer = ChildWriter(path, ABOUT, clock)
    for number in range(2500):
        writer.take(clock.now(), Wire("sent", bytes([number % 256]), clock.now()))
    writer.take(clock.now(), Event("mark", "last"))
    writer.close()
    status = writer.status()
    assert (status.path, status.messages, status.dropped, status.problem) == (str(path), 2501, 0, "")
    assert status.size == path.stat().st_size
    recording = Recording(path)
    assert recording.about == ABOUT
    times = [entry.time for entry in recording.entries()]
    assert times == sorted(times)
    assert abs(times[-1] - time.time_ns()) < 60_000_000_000


def test_a_process_that_is_killed_ends_the_recording_alone(tmp_path: Path) -> None:
    writer = ChildWriter(tmp_path / "out.mcap", ABOUT, Clock())
    writer._process.kill()
    writer._process.wait()
    writer.take(0.0, Event("mark", "lost"))
    with pytest.raises(RecordingError, match="has ended; was the process killed"):
        writer.close()
    assert "was the process killed" in writer.status().problem


def test_a_file_that_cannot_be_made(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot record to"):
        ChildWriter(tmp_path / "no" / "out.mcap", ABOUT, Clock())


def test_a_program_that_has_crashed_is_told_nothing(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    order = msgspec.msgpack.encode(Order(str(path), ABOUT, 0.0, 0))
    (tmp_path / "order").write_bytes(LENGTH.pack(len(order)) + order)
    gone, stdout = os.pipe()
    os.close(gone)
    with open(tmp_path / "order", "rb") as stdin, open(stdout, "wb") as nobody:
        done = processes.run((sys.executable, "-m", "servolink.recorder.child"), stdin=stdin, stdout=nobody)
    assert (done.returncode, done.stderr) == (0, "")
    recording = Recording(path)
    assert recording.about == ABOUT


_CRASH = """
import asyncio, os, sys
import servolink

async def main():
    async with servolink.connect("virtual://") as board, servolink.record(sys.argv[1], board):
        await board.move({1: 20}, duration=0.1, wait=True)
        await asyncio.sleep(0.3)
        os._exit(3)

asyncio.run(main())
"""


@pytest.mark.slow
def test_a_program_that_crashes_leaves_a_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    done = processes.run((sys.executable, "-c", _CRASH, str(path)))
    assert done.returncode == 3
    processes.until(lambda: path.stat().st_size >= 100 and path.read_bytes().endswith(MAGIC))
    recording = Recording(path)
    assert "ExecuteActionRequest" in {getattr(entry.message, "packet", "") for entry in recording.entries()}
    assert recording.remarks == []
