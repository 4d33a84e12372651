"""Damage in a recording costs what it hits, and is told: by `show` and by `record --repair`.

Modules: servolink.recorder.mcap_check, servolink.recorder.mcap_index, servolink.recorder.mcap_stream.
"""

from __future__ import annotations

import random
import struct
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader, make_reader

from servolink.recorder.channels import Event, Message, encode
from servolink.recorder.mcap_reader import LARGEST, MAGIC, McapReader, UnusableChunk, decompress, find_record
from servolink.recorder.mcap_stream import McapStream
from servolink.recorder.reading import Entry, Recording
from servolink.recorder.repairing import repair
from tests.recorder.test_reading import CHANNEL, MARK, chunk, record
from tests.recorder.test_repairing import ABOUT, blocks
from tests.sampling import every, some
from tests.tables import over

CHUNKS, EACH = 5, 12
KIND, LENGTH = 0, 1  # places in a record


def read(path: Path) -> tuple[list[Entry[Message]], list[str]]:
    """Return the messages of a file, and what is said of it."""
    recording = Recording(path)
    return list(recording.entries()), recording.remarks


def damaged(path: Path, block: int, place: int, bit: int) -> list[bytes]:
    """Write a recording in which one bit of one block is wrong; return its blocks as they were."""
    made = blocks(CHUNKS, EACH)
    wrong = bytearray(made[block])
    wrong[place] ^= 1 << bit
    path.write_bytes(b"".join((*made[:block], wrong, *made[block + 1 :])))
    return made


@every(211)
@pytest.mark.parametrize("bit", range(8))
def test_one_wrong_bit_loses_nothing_silently(bit: int, step: int, tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    stream = McapStream(ABOUT)
    parts = [stream.head()]
    for at in range(3):
        stream.add("/events", at, encode(Event("mark", "mark", text=f"{at}")))
        parts.append(stream.chunk())
    whole = b"".join((*parts, stream.end()))
    path.write_bytes(whole)
    messages, said = read(path)
    assert (len(messages), said) == (3, [])
    for at in some(len(MAGIC), len(whole), step):
        wrong = bytearray(whole)
        wrong[at] ^= 1 << bit
        path.write_bytes(wrong)
        found, said = read(path)
        assert found == messages or said, f"byte {at} of {len(whole)}"


def read_by_others(path: Path) -> list[int]:
    """Return the times of all messages as the library `mcap` reads them, by the index and one after the other."""
    with path.open("rb") as file:
        by_index = [message.log_time for _, _, message in make_reader(file, validate_crcs=True).iter_messages()]
        file.seek(0)
        in_order = [message.log_time for _, _, message in NonSeekingReader(file).iter_messages()]
    assert by_index == in_order
    return by_index


@every(79)
@pytest.mark.parametrize("bit", range(8))
def test_others_read_all_that_repair_calls_whole_or_writes(bit: int, step: int, tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    made = blocks(2, 3)
    whole = b"".join(made)
    times = [0, 1, 2, 1000, 1001, 1002]
    for eighth in some(0, (len(whole) - len(MAGIC) - bit) // 8, step):  # so that each byte is hit by one of the tests
        at = len(MAGIC) + 8 * eighth + bit
        wrong = bytearray(whole)
        wrong[at] ^= 1 << bit
        path.write_bytes(wrong)
        done = repair(path)
        found = read_by_others(path)
        assert len(found) == done.messages, f"byte {at} of {len(whole)}"
        assert found == times or (done.original and set(found) <= set(times)), f"byte {at} of {len(whole)}"
        assert done.original or path.read_bytes() == wrong
        if done.original:
            assert done.remarks
            assert not repair(path).original
            Path(done.original).unlink()


def test_a_wrong_offset_in_the_index_is_found(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    made = blocks(2, 3)
    start = len(made[0]).to_bytes(8, "little")  # of the first chunk
    path.write_bytes(b"".join((*made[:-1], made[-1].replace(start, (len(made[0]) + 1).to_bytes(8, "little")))))
    done = repair(path)
    assert (done.messages, done.remarks) == (
        6,
        ("the index, by which other programs find messages, was damaged; it was made anew",),
    )
    assert len(read_by_others(path)) == 6


@pytest.mark.parametrize("bit", range(8))
def test_a_wrong_kind_costs_one_chunk(bit: int, tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    damaged(path, 2, KIND, bit)
    done = repair(path)
    assert done.messages == (CHUNKS - 1) * EACH
    assert f"messages are missing, by the count at the end of the file ({EACH})" in done.remarks
    assert done.original
    assert not repair(path).original


@over("bit", range(64))
def test_a_wrong_length_costs_one_chunk_at_most(bit: int, tmp_path: Path) -> None:
    path = tmp_path / f"{bit}.mcap"
    made = damaged(path, 2, LENGTH + bit // 8, bit % 8)
    times = [message.time for message in read(path)[0]]
    assert set(times) >= {chunk * 1000 + number for chunk in (0, 2, 3, 4) for number in range(EACH)}
    assert times == sorted(set(times))
    done = repair(path)
    assert done.original
    assert done.messages == len(times)
    lost = CHUNKS * EACH - len(times)
    assert lost in (0, EACH)
    assert (f"messages are missing, by the count at the end of the file ({lost})" in done.remarks) == bool(lost)
    assert Path(done.original).stat().st_size == sum(map(len, made))


@pytest.mark.parametrize("place", [0, 1, 2, 8])
def test_damage_in_front_costs_no_message(place: int, tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    damaged(path, 0, len(MAGIC) + place, 0)
    assert len(read(path)[0]) == CHUNKS * EACH


def test_bytes_between_records_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    made = blocks(CHUNKS, EACH)
    noise = bytes(1) + random.Random(1).randbytes(300_000)
    path.write_bytes(b"".join((*made[:3], noise, *made[3:])))
    messages, (said,) = read(path)
    assert len(messages) == CHUNKS * EACH
    count = int(said.removeprefix("bytes outside of records were left out (").removesuffix(")"))
    assert len(noise) <= count < len(noise) + len(made[2])


def test_a_recording_behind_another_one_is_not_passed_over_in_silence(tmp_path: Path) -> None:
    path = tmp_path / "both.mcap"
    one, other = (b"".join(blocks(chunks, EACH)) for chunks in (2, 3))
    path.write_bytes(one + other)
    done = repair(path)
    assert done.messages == 2 * EACH
    assert done.remarks == (f"bytes behind the end of the recording were left out ({len(other)})",)
    assert Path(done.original).read_bytes() == one + other


@pytest.mark.parametrize("behind", [0, LARGEST // 4])
def test_hostile_lengths_take_no_more_time_than_they_have_bytes(behind: int, tmp_path: Path) -> None:
    """Records that swallow what follows, and chunks in between: no byte is read more than some times."""
    path = tmp_path / "x.mcap"
    lying = struct.pack("<BQ", 0x05, LARGEST // 8)
    small = chunk(MARK, b"", MARK)
    path.write_bytes(MAGIC + CHANNEL + (lying + small) * 2000 + bytes(behind))
    took = 0
    reader = McapReader(path)
    take = reader._take

    def counting(size: int) -> bytes:
        nonlocal took
        data = take(size)
        took += len(data)
        return data

    reader._take = counting  # type: ignore[method-assign]
    assert len(list(reader.records())) >= 1
    assert took < 16 * path.stat().st_size
    assert reader.is_cut


@pytest.mark.parametrize("gap", [0, 1, 511, 512, 995, 1000, 1001, 70_000])
def test_a_chunk_is_found_wherever_the_window_ends(gap: int) -> None:
    whole = bytes(gap) + chunk(MARK, b"", MARK) + record(0x99, b"")
    chunks = iter([whole[at : at + 1000] for at in range(0, len(whole), 1000)])
    assert find_record(lambda _: next(chunks, b""), 0, len(whole)) == gap


def test_a_chunk_whose_lengths_do_not_agree_is_not_found() -> None:
    wrong = bytearray(chunk(MARK, b"", MARK))
    wrong[45] ^= 1
    data = iter([bytes(wrong)])
    assert find_record(lambda _: next(data, b""), 0, len(wrong)) is None
    short = chunk(MARK, b"", MARK)[:-1]
    data = iter([short])
    assert find_record(lambda _: next(data, b""), 0, len(short)) is None


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_a_chunk_that_claims_to_be_huge_takes_no_memory(compression: str) -> None:
    with pytest.raises(UnusableChunk, match="larger than 16 MiB"):
        decompress(compression, b"", 1 << 60)
