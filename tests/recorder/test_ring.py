"""The ring: what it keeps, in how much memory, and when it is written.

Modules: servolink.recorder.board_source, servolink.recorder.clock.
"""

from __future__ import annotations

import os
import random
import tracemalloc
from pathlib import Path

import pytest

from servolink.errors import RecordingError
from servolink.protocol import SetServoParameterRequest
from servolink.recorder.backlog import Timed
from servolink.recorder.board_source import BoardTap
from servolink.recorder.channels import CommandDone, Event, Message, PacketSeen, Recorded, Wire
from servolink.recorder.clock import Clock
from servolink.recorder.reading import Recording
from servolink.recorder.recorder import Recorder, Wanted
from servolink.recorder.ring import AFTER, RingWriter, Segments, trigger
from servolink.recorder.writer import CHUNK_BYTES, Saved
from tests.client.piped_board import PipedBoard, opened
from tests.virtual_time import run

ABOUT = Recorded("0", "2026-11-22T16:00:00Z", "rex", "board")
STOP = SetServoParameterRequest(255, 0, 1)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (Event("connection", "lost"), "the connection was lost"),
        (Event("connection", "connected"), ""),
        (Event("alarm", "servo 3 is hot"), "servo 3 is hot"),
        (CommandDone("WriteProjectIDRequest", {}, "unknown"), "the outcome of WriteProjectIDRequest is unknown"),
        (CommandDone("WriteProjectIDRequest", {}, "answered"), ""),
        (CommandDone("SetServoParameterRequest", STOP, "sent", who="studio"), "studio has stopped the servos"),  # type: ignore[arg-type]
        (
            CommandDone("SetServoParameterRequest", {"servo_id": 255, "is_start": 0, "is_hold": 1}, "answered"),
            "the program has stopped the servos",
        ),
        (CommandDone("SetServoParameterRequest", {"servo_id": 1, "is_start": 0, "is_hold": 1}, "answered"), ""),
        (Wire("sent", b"", 0.0), ""),
    ],
)
def test_what_counts_as_a_failure(message: Message, reason: str) -> None:
    assert trigger(message) == reason


def test_only_the_latest_messages_are_kept() -> None:
    segments = Segments(10)
    for second in range(100):
        segments.add(Timed(float(second), Event("mark", str(second))))
    kept = [seconds for seconds, _, _ in segments.messages()]
    assert kept[-1] == 99
    assert 88 <= kept[0] <= 89
    assert len(kept) == segments.count
    segments.clear()
    assert (segments.size, segments.count, list(segments.messages())) == (0, 0, [])


def test_memory_is_bounded_whatever_comes() -> None:
    """Random bytes, which no compression makes smaller: ten times the bound."""
    bound = 512 * 1024
    noise = random.Random(1)
    chunks = [noise.randbytes(1024) for _ in range(64)]
    tracemalloc.start()
    try:
        segments = Segments(3600, bound)
        before, _ = tracemalloc.get_traced_memory()
        for number in range(5 * 1024):
            segments.add(Timed(number / 1000, Wire("received", noise.choice(chunks), number / 1000)))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert segments.size <= bound
    assert peak - before < bound + 6 * CHUNK_BYTES  # what is being compressed


def kept(tmp_path: Path, message: Message, *, until: float) -> tuple[Saved, ...]:
    """Return the files that a ring writes of some messages."""
    now = 1000.0
    clock = Clock(lambda: now)
    ring = RingWriter(tmp_path / "out.mcap", ABOUT, clock, 60)
    backlog = ring._backlog
    for second in range(10):
        backlog.put(now + second, Event("mark", str(second)))
    backlog.put(now + 10, message)
    now += until
    ring.close()
    return ring.status().saved


def test_it_is_written_when_something_fails(tmp_path: Path) -> None:
    (saved,) = kept(tmp_path, Event("connection", "lost"), until=10 + AFTER)
    assert saved.reason == "the connection was lost"
    path = Path(saved.path)
    assert path.name.startswith("out-20")
    assert saved.size == path.stat().st_size
    recording = Recording(path)
    found = [entry.message for entry in recording.entries()]
    assert recording.remarks == []
    assert [each.what for each in found if isinstance(each, Event)] == [*map(str, range(10)), "lost", "saved"]


def test_it_is_not_written_when_nothing_fails(tmp_path: Path) -> None:
    assert kept(tmp_path, Event("mark", "well"), until=100) == ()
    assert list(tmp_path.iterdir()) == []


def test_a_recorder_writes_it_with_packets(tmp_path: Path) -> None:
    async def main() -> tuple[Saved, ...]:
        board = PipedBoard()
        async with opened(board, angle_unit=None) as client:
            recorder = Recorder(Wanted(tmp_path / "out.mcap", ring=60))
            client.connection.taps.add(BoardTap(recorder.take))
            recorder.begin(recorder.about("rex", "board", "little", "utf-8"))
            await client.servos()
            recorder.save("asked for")
            await recorder.end()
            return recorder.status.saved

    (saved,) = run(main())
    assert saved.reason == "asked for"
    recording = Recording(saved.path)
    packets = [entry.message.packet for entry in recording.entries() if isinstance(entry.message, PacketSeen)]
    assert "QueryServoResponse" in packets


class FullDisk:
    """A disk without room."""

    def __init__(self) -> None:
        self.is_full = True

    def write(self, descriptor: int, data: memoryview, /) -> int:
        if self.is_full:
            raise OSError(28, "No space left on device")
        return os.write(descriptor, data)

    fsync = staticmethod(os.fsync)
    ftruncate = staticmethod(os.ftruncate)


def test_a_full_disk_keeps_it_in_memory(tmp_path: Path) -> None:
    disk = FullDisk()
    clock = Clock(lambda: 1000.0)
    ring = RingWriter(tmp_path / "out.mcap", ABOUT, clock, 60, disk=disk)
    ring.fail("it failed")
    with pytest.raises(RecordingError, match="No space left on device"):
        ring.close()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_does_not_exist(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="does not exist; create it first"):
        RingWriter(tmp_path / "no" / "out.mcap", ABOUT, Clock(), 60)
