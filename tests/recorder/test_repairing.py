"""Repair: a file that was cut anywhere keeps all of its whole chunks.

Module: servolink.recorder.recording_file.
"""

from __future__ import annotations

import errno
import io
import random
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

import servolink
from servolink.errors import RecordingError
from servolink.recorder.channels import Event, Recorded, Wire, decode, encode
from servolink.recorder.mcap_reader import MAGIC, McapReader
from servolink.recorder.mcap_stream import McapStream
from servolink.recorder.reading import Recording
from servolink.recorder.recording_file import RecordingFile
from servolink.recorder.repairing import Mending, repair
from tests.cli.programs import call

ABOUT = Recorded("0", "2026-11-22T16:00:00Z", "rex", "board", byte_order="big")
STEP = 997


def blocks(chunks: int = 40, size: int = 12) -> list[bytes]:
    """Return the blocks of a recording: its head, chunks of `size` messages, and its end."""
    stream, noise = McapStream(ABOUT), random.Random(1)
    made = [stream.head()]
    for chunk in range(chunks):
        for number in range(size):
            stream.add("/wire", chunk * 1000 + number, encode(Wire("sent", noise.randbytes(60), float(chunk))))
        made.append(stream.chunk())
    return [*made, stream.end()]


def test_a_file_cut_anywhere_keeps_its_whole_chunks(tmp_path: Path) -> None:
    made = blocks(24)
    whole = b"".join(made)
    ends = [sum(map(len, made[: count + 1])) for count in range(len(made))]
    path = tmp_path / "cut.mcap"
    for cut in range(len(MAGIC), len(whole), STEP):
        path.write_bytes(whole[:cut])
        mended = b"".join(Mending(McapReader(path)).blocks())
        messages = [message for _, _, message in make_reader(io.BytesIO(mended), validate_crcs=True).iter_messages()]
        least = 12 * sum(end <= cut for end in ends[1:-1])
        # A chunk is followed by its index, so that one that is whole may be read before its block ends.
        assert least <= len(messages) <= least + 12
        assert len(messages) % 12 == 0
        times = [chunk * 1000 + number for chunk in range(len(messages) // 12) for number in range(12)]
        assert [message.log_time for message in messages] == times
        assert all(isinstance(decode("/wire", message.data), Wire) for message in messages)


def test_the_file_is_replaced_and_the_original_kept(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    cut = b"".join(blocks()[:20])[:-3]
    path.write_bytes(cut)
    done = repair(path)
    assert done.messages == 12 * 19
    assert Path(done.original).read_bytes() == cut
    recording = Recording(path)
    assert len(list(recording.entries())) == done.messages
    assert recording.remarks == []
    assert recording.about == ABOUT
    assert sorted(each.name for each in tmp_path.iterdir()) == ["out.mcap", "out.mcap.cut"]


def test_an_original_is_never_lost(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    whole = b"".join(blocks())
    path.write_bytes(whole[:-3])
    repair(path)
    assert not repair(path).original  # it is whole now, whatever lies beside it
    path.write_bytes(whole[:-30])
    with pytest.raises(RecordingError, match="would be lost"):
        repair(path)
    assert path.read_bytes() == whole[:-30]
    assert sorted(each.name for each in tmp_path.iterdir()) == ["out.mcap", "out.mcap.cut"]


@pytest.mark.parametrize("missing", [0, 1, 8, 20])
def test_a_whole_file_is_left_alone(tmp_path: Path, missing: int) -> None:
    path = tmp_path / "out.mcap"
    data = b"".join(blocks())
    path.write_bytes(data[: len(data) - missing])
    done = repair(path)
    assert bool(done.original) == bool(missing)
    if not missing:
        assert path.read_bytes() == data
        assert [each.name for each in tmp_path.iterdir()] == ["out.mcap"]


def test_damage_in_the_middle_costs_that_chunk(tmp_path: Path) -> None:
    made = blocks()
    damaged = bytearray(made[5])
    damaged[80] ^= 0xFF
    path = tmp_path / "out.mcap"
    path.write_bytes(b"".join((*made[:5], bytes(damaged), *made[6:])))
    done = repair(path)
    assert done.messages == 12 * 39
    assert done.remarks == (
        "damaged chunks were left out (1)",
        "messages are missing, by the count at the end of the file (12)",
    )


def other_program() -> bytes:
    """Return the beginning of a file that another program wrote, without its end."""
    file = io.BytesIO()
    writer = Writer(file, use_chunking=False)
    writer.start("ros2", "rosbag2")
    channel = writer.register_channel("/tf", "cdr", 0)
    for number in range(3):
        writer.add_message(channel, number, b"pose", number)
    return file.getvalue()


def test_a_file_of_another_program_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "bag.mcap"
    path.write_bytes(other_program())
    with pytest.raises(RecordingError, match="nothing of a recording is left"):
        repair(path)
    assert path.read_bytes() == other_program()
    assert [each.name for each in tmp_path.iterdir()] == ["bag.mcap"]


def test_it_says_what_of_another_program_was_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "both.mcap"
    path.write_bytes(b"".join(blocks()[:3]) + other_program()[len(MAGIC) :])
    said = call(capsys, "record", "--repair", str(path))
    assert said.out.startswith(f"repaired {path}: 24 messages;")
    assert said.err == f"servolink: {path}: messages of foreign channels were left out (3)\n"


def test_what_is_no_recording_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    path.write_bytes(b"mine")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        repair(path)
    assert [each.name for each in tmp_path.iterdir()] == ["out.mcap"]


def test_a_recording_under_way_is_left_to_its_recorder(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    made = blocks()
    file = RecordingFile(path)
    for block in made[:20]:
        assert file.put(block)
    with pytest.raises(RecordingError, match="is still being recorded; end the recorder first"):
        repair(path)
    for block in made[20:]:
        assert file.put(block)
    file.close()
    assert path.read_bytes() == b"".join(made)
    assert [each.name for each in tmp_path.iterdir()] == ["out.mcap"]
    assert repair(path).messages == 12 * 40


def test_the_recorder_of_a_program_has_its_file_for_itself(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    with (
        servolink.sync.connect("virtual://?servos=2") as board,
        servolink.sync.record(path, board, hz=0),
        pytest.raises(RecordingError, match="is still being recorded"),
    ):
        repair(path)
    assert not repair(path).original


def test_what_a_killed_repair_has_left_is_replaced(tmp_path: Path) -> None:
    path, left = tmp_path / "out.mcap", tmp_path / "out.mcap.repairing"
    made = blocks()
    path.write_bytes(b"".join(made[:20]))
    left.write_bytes(b"".join(made[:10]))
    assert repair(path).messages == 12 * 19
    assert sorted(each.name for each in tmp_path.iterdir()) == ["out.mcap", "out.mcap.cut"]


def test_two_repairs_do_not_meet(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    cut = b"".join(blocks()[:20])
    path.write_bytes(cut)
    other = RecordingFile(tmp_path / "out.mcap.repairing")
    with pytest.raises(RecordingError, match="is being repaired already"):
        repair(path)
    other.close()
    assert path.read_bytes() == cut
    assert other.path.exists()


@pytest.mark.skipif(sys.platform == "win32", reason="permissions of POSIX")
def test_a_protected_file_is_repaired(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "out.mcap"
    path.write_bytes(b"".join(blocks()[:5]))

    def refused(*_: object, **__: object) -> None:  # also where tests run as root
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("servolink.recorder.recording_file.open_file", refused)
    assert repair(path).messages == 48


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "out.mcap"
    path.write_bytes(b"".join(blocks()[:5]))
    said = call(capsys, "record", "--repair", str(path))
    assert said.out == f"repaired {path}: 48 messages; the file as it was is {path}.cut\n"
    Path(f"{path}.cut").unlink()
    assert (
        call(capsys, "record", "--repair", str(path)).out == f"{path} is whole, with 48 messages; nothing was changed\n"
    )
    assert call(capsys, "record", "--repair", str(path), "--json").json == {
        "messages": 48,
        "original": None,
        "remarks": [],
    }


def test_events_are_kept(tmp_path: Path) -> None:
    stream = McapStream(ABOUT)
    head = stream.head()
    stream.add("/events", 1, encode(Event("mark", "here")))
    path = tmp_path / "out.mcap"
    path.write_bytes(head + stream.chunk())
    repair(path)
    recording = Recording(path)
    assert [entry.message for entry in recording.entries()] == [Event("mark", "here")]
