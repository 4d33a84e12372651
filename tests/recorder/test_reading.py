"""A recording is read in order and in bounded memory, however its file is cut, damaged or made up.

Modules: servolink.recorder.mcap_reader, servolink.recorder.readings.
"""

from __future__ import annotations

import random
import struct
import tracemalloc
import zlib
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.writer import CompressionType

from servolink.errors import RecordingError
from servolink.recorder.channels import (
    CommandDone,
    Event,
    Message,
    PacketSeen,
    ProblemFound,
    RecordedServo,
    ServosRead,
    Wire,
)
from servolink.recorder.mcap_reader import LARGEST, MAGIC
from servolink.recorder.reading import Recording, Selection
from tests.recorder.files import START, write

SERVO = RecordedServo(3, 90.0, "degree", 5, 300, 1, is_start=True, is_hold=True)
MESSAGES: list[tuple[float, Message]] = [
    (0.0, Wire("sent", b"\x13\x4c", 1.0)),
    (0.5, PacketSeen("sent", 20040, "SetAngleUnitRequest", {"servo_id": 3, "unit_type": 0}, 11)),
    (0.6, PacketSeen("received", noise=4, data=b"abcd")),
    (0.7, CommandDone("SetAngleUnitRequest", {"servo_id": 3, "unit_type": 0}, "answered", 0.2, "studio")),
    (0.8, CommandDone("ExecuteActionRequest", {"steps": [{"servo_id": 4}]}, "unknown", 3.0)),
    (1.0, ServosRead((SERVO,))),
    (1.5, Event("mark", "mark", text="here")),
    (2.0, ProblemFound("dropped", "the disk is slow", "/servos", 9)),
]
METADATA_RECORD, CHANNEL_RECORD, MESSAGE_RECORD, CHUNK_RECORD = 0x0C, 0x04, 0x05, 0x06


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def chunk(data: bytes, compression: bytes, packed: bytes, *, size: int | None = None, crc: int | None = None) -> bytes:
    head = struct.pack("<QQQI", 0, 0, len(data) if size is None else size, zlib.crc32(data) if crc is None else crc)
    return record(CHUNK_RECORD, head + text(compression) + struct.pack("<Q", len(packed)) + packed)


CHANNEL = record(CHANNEL_RECORD, struct.pack("<HH", 1, 0) + text(b"/events") + text(b"json") + struct.pack("<I", 0))
MARK = record(MESSAGE_RECORD, struct.pack("<HIQQ", 1, 0, START, START) + b'{"kind":"mark","what":"here"}')
END = record(0x02, bytes(20)) + MAGIC


def made_up(path: Path, *records: bytes) -> Recording:
    path.write_bytes(MAGIC + record(0x01, text(b"") + text(b"")) + b"".join(records))
    return Recording(path)


@pytest.mark.parametrize("compression", CompressionType)
def test_messages_come_back(tmp_path: Path, compression: CompressionType) -> None:
    recording = Recording(write(tmp_path / "out.mcap", MESSAGES, compression=compression, chunk_size=100))
    assert recording.about is not None
    assert (recording.about.board, recording.about.through) == ("rex", "hub")
    assert recording.started == START
    assert [(round(each.seconds, 6), each.message) for each in recording.entries()] == MESSAGES
    assert recording.remarks == []


@pytest.mark.parametrize(
    ("selection", "wanted"),
    [
        (Selection(since=0.65, until=1.0), {3, 4, 5}),
        (Selection(topics=frozenset({"/wire", "/problems"})), {0, 7}),
        (Selection(packet="setangleunit"), {1, 3}),
        (Selection(packet="SetAngleUnitRequest", until=0.6), {1}),
        (Selection(servo_id=3), {1, 3, 5}),
        (Selection(servo_id=4), {4}),
        (Selection(only_problems=True), {2, 4, 7}),
    ],
)
def test_selection(tmp_path: Path, selection: Selection, wanted: set[int]) -> None:
    recording = Recording(write(tmp_path / "out.mcap", MESSAGES))
    assert [each.message for each in recording.entries(selection)] == [MESSAGES[at][1] for at in sorted(wanted)]


TRIM = PacketSeen("sent", 30110, "AddServoParameterRequest", {"servos": [{"servo_id": 3}]}, 20)
TRIMMED = PacketSeen("received", 30111, "AddServoParameterResponse", {"result": 1}, 11)
ASK_ALL = PacketSeen("sent", 20020, "QueryServoRequest", {"servo_id": 255}, 10)
ANSWER_ALL = PacketSeen("received", 20021, "QueryServoResponse", {"servos": [{"servo_id": 4}]}, 30)


@pytest.mark.parametrize(
    ("selection", "wanted"),
    [
        (Selection(servo_id=3), {0, 1, 2, 3}),
        (Selection(servo_id=4), {0, 1}),
        (Selection(until=1.05), {0, 1, 2, 3}),
        (Selection(since=0.05), {2, 3, 4}),
    ],
)
def test_response_is_selected_with_its_request(tmp_path: Path, selection: Selection, wanted: set[int]) -> None:
    unasked = PacketSeen("received", 20021, "QueryServoResponse", {"servos": []}, 30)
    messages: list[tuple[float, Message]] = [(0, ASK_ALL), (0.1, ANSWER_ALL), (1, TRIM), (1.1, TRIMMED), (9, unasked)]
    recording = Recording(write(tmp_path / "out.mcap", messages))
    assert [each.message for each in recording.entries(selection)] == [messages[at][1] for at in sorted(wanted)]


def test_file_cut_anywhere_gives_what_is_whole(tmp_path: Path) -> None:
    whole = write(tmp_path / "out.mcap", MESSAGES * 5, chunk_size=200).read_bytes()
    cut, counts = tmp_path / "cut.mcap", []
    for size in range(len(MAGIC), len(whole), 499):
        cut.write_bytes(whole[:size])
        recording = Recording(cut)
        counts.append(len(list(recording.entries())))
        remarks = recording.remarks
        assert not remarks or "the file is cut" in remarks[-1]
    assert counts[0] == 0
    assert counts[-1] == len(MESSAGES) * 5
    assert counts == sorted(counts)


def test_damage_is_counted_and_never_raised(tmp_path: Path) -> None:
    whole = write(tmp_path / "out.mcap", MESSAGES, chunk_size=200).read_bytes()
    chance, path = random.Random(1), tmp_path / "damaged.mcap"
    for _ in range(60):
        damaged = bytearray(whole)
        for _ in range(chance.randrange(1, 4)):
            damaged[chance.randrange(len(MAGIC), len(whole))] = chance.randrange(256)
        path.write_bytes(damaged)
        recording = Recording(path)
        assert len(list(recording.entries())) <= len(MESSAGES)
        assert all(isinstance(each, str) for each in recording.remarks)


@pytest.mark.parametrize("content", [b"", MAGIC[:5], b"{}", b"\x89MCAP1\r\n" + bytes(100)])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="is not an MCAP file"):
        Recording(path)


@pytest.mark.parametrize("name", ["none.mcap", "nul\0", "."])
def test_what_is_no_file_is_an_error(tmp_path: Path, name: str) -> None:
    with pytest.raises(RecordingError, match="cannot read the recording"):
        Recording(tmp_path / name)


BOMB = bytes(8 * LARGEST)


@pytest.mark.parametrize(
    ("hostile", "remark"),
    [
        (chunk(BOMB, b"zstd", zstandard.compress(BOMB)), "chunks larger than 16 MiB"),
        (chunk(BOMB, b"zstd", zstandard.compress(BOMB), size=1000), "damaged chunks"),
        (chunk(BOMB, b"lz4", lz4.frame.compress(BOMB), size=1000), "damaged chunks"),
        (chunk(b"x" * 99, b"zstd", b"nonsense"), "damaged chunks"),
        (chunk(b"x" * 99, b"lz4", b"nonsense"), "damaged chunks"),
        (chunk(b"x", b"brotli", b"x"), "chunks compressed with 'brotli'"),
        (chunk(b"x", b"\x1b[2J", b"x"), "x1b"),
        (chunk(MARK, b"", MARK, crc=1), "damaged chunks"),
        (chunk(MARK[:-1], b"", MARK[:-1]), "unreadable messages of /events"),
        (chunk(chunk(MARK, b"", MARK), b"", chunk(MARK, b"", MARK)), ""),
        (record(CHANNEL_RECORD, struct.pack("<HHI", 2, 0, 2**32 - 1)), "with contradictions"),
        (record(METADATA_RECORD, text(b"servolink") + struct.pack("<I", 2**32 - 1)), "with contradictions"),
        (record(METADATA_RECORD, text(b"servolink") + struct.pack("<I", 0)), "descriptions of the recording"),
        (record(MESSAGE_RECORD, struct.pack("<HIQQ", 9, 0, 0, 0)), "unknown channels"),
        (record(MESSAGE_RECORD, b"short"), "with contradictions"),
        (record(MESSAGE_RECORD, struct.pack("<HIQQ", 1, 0, 0, 0) + b"[" * 9999), "messages of /events"),
        (record(0x99, bytes(1000)), "records of unknown kinds"),
    ],
)
def test_hostile_record_is_left_out(tmp_path: Path, hostile: bytes, remark: str) -> None:
    tracemalloc.start()
    try:
        recording = made_up(tmp_path / "x.mcap", CHANNEL, hostile, MARK, END)
        assert [each.message for each in recording.entries()] == [Event("mark", "here")]
        assert tracemalloc.get_traced_memory()[1] < 4 * LARGEST
    finally:
        tracemalloc.stop()
    assert all(map(str.isprintable, recording.remarks))
    assert [remark in each for each in recording.remarks] == [True] * bool(remark)


@pytest.mark.parametrize("kind", [0x01, CHANNEL_RECORD, CHUNK_RECORD, 0x09, 0x99])
@pytest.mark.parametrize("size", [LARGEST, 2**40, 2**64 - 1])
def test_size_that_lies_ends_the_file_and_costs_nothing(tmp_path: Path, kind: int, size: int) -> None:
    tracemalloc.start()
    try:
        recording = made_up(tmp_path / "x.mcap", CHANNEL, MARK, struct.pack("<BQ", kind, size))
        assert len(list(recording.entries())) == 1
        assert tracemalloc.get_traced_memory()[1] < LARGEST
    finally:
        tracemalloc.stop()
    assert "the file is cut" in recording.remarks[-1]


def test_unknown_byte_order_is_read_as_the_usual_one(tmp_path: Path) -> None:
    about = {"version": "9", "started": "", "board": "", "through": "board", "byte_order": "middle"}
    recording = Recording(write(tmp_path / "x.mcap", [], about=about))
    assert recording.codec.byte_order == "little"
    assert list(recording.entries()) == []
    assert recording.started == 0
