"""Frames that follow each other in long chunks are cut by another call than single ones; nothing else differs."""

from __future__ import annotations

from random import Random

import pytest

from benchmarks.streams import any_frame, chunks, damaged_line
from servolink.protocol.frame import Frame, encode_frame
from servolink.protocol.parser import CHECKSUM, NOISE, PADDING, FrameParser
from servolink.protocol.servos import QueryServoRequest
from servolink.protocol.settings import SendDummyDataRequest

GOOD = encode_frame(QueryServoRequest.packet_id, b"\x07", "little")
FOUND: Frame = (QueryServoRequest.packet_id, b"\x07")
WRONG_SUM = GOOD[:-1] + bytes([GOOD[-1] ^ 1])


def acquainted(parser: FrameParser, frames: list[bytes]) -> FrameParser:
    """Return `parser` after it has read all these frames on an undamaged line."""
    for frame in frames:
        assert len(parser.feed(frame)) == 1
    return parser


@pytest.mark.parametrize(
    ("between", "reasons"),
    [(b"", {}), (WRONG_SUM, {CHECKSUM: len(WRONG_SUM)}), (b"noise", {NOISE: 5}), (bytes(9), {PADDING: 9})],
)
@pytest.mark.parametrize("end", [b"", GOOD[:3], GOOD[:-1]])
def test_frames_in_a_row_end_at_anything_else_and_before_an_incomplete_frame(
    between: bytes, reasons: dict[str, int], end: bytes
) -> None:
    parser = acquainted(FrameParser(), [GOOD])
    assert parser.feed(GOOD * 100 + between + GOOD * 100 + end) == [FOUND] * 200
    assert parser.feed(GOOD[len(end) :]) == [FOUND]
    assert {reason: count for reason, count in parser.skipped.items() if count} == reasons


@pytest.mark.parametrize("seed", range(20))
def test_long_chunks_give_the_same_frames_as_short_ones(seed: int) -> None:
    random = Random(seed)
    corpus = [any_frame(random, "little") for _ in range(100)]
    clean = b"".join(random.choices(corpus, k=2000))
    stream = clean + damaged_line(random, 50, "little")[0] + GOOD * 300 + clean
    found = []
    for size in (100, 600, 4096, len(stream)):
        parser = acquainted(FrameParser(), corpus)
        frames = [frame for chunk in chunks(stream, size) for frame in parser.feed(chunk)]
        found.append((frames + parser.finish(), parser.skipped))
    assert found[1:] == found[:1] * 3


@pytest.mark.parametrize("length", [0, 1, 254, 255, 256, 257])
@pytest.mark.parametrize("byte", [b"\0", b"\xff"])
def test_one_sum_of_all_is_accepted(length: int, byte: bytes) -> None:
    right = encode_frame(SendDummyDataRequest.packet_id, byte * length, "little")
    for checksum in range(256):
        parser = acquainted(FrameParser(), [right])
        frames = parser.feed((right[:-1] + bytes([checksum])) * 60)
        assert len(frames) == (60 if checksum == right[-1] else 0)
