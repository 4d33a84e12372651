"""How a stream is cut makes no difference.

Frames that follow each other in long chunks are cut by another call than the last one, and a chunk that is one whole
frame is not scanned at all.

Module: servolink.protocol.recovery.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import accumulate, pairwise
from random import Random
from typing import Any

import pytest

from benchmarks.streams import any_frame, chunks, damaged_line
from servolink.protocol.frame import HEADER, MAGIC, BlockSums, ByteOrder, Frame, encode_frame
from servolink.protocol.parser import CHECKSUM, NOISE, FrameParser, _SearchingParser
from servolink.protocol.recovery import Recovery
from servolink.protocol.servos import QueryServoRequest
from servolink.protocol.settings import SendDummyDataRequest
from tests.sampling import sampled

GOOD = encode_frame(QueryServoRequest.packet_id, b"\x07", "little")
BYTE_ORDERS: tuple[ByteOrder, ...] = ("little", "big")
FOUND: Frame = (QueryServoRequest.packet_id, b"\x07")
WRONG_SUM = GOOD[:-1] + bytes([GOOD[-1] ^ 1])


def acquainted(parser: FrameParser, frames: list[bytes]) -> FrameParser:
    """Return `parser` after it has read all these frames on an undamaged line."""
    for frame in frames:
        assert len(parser.feed(frame)) == 1
    return parser


@pytest.mark.parametrize(
    ("between", "reasons"),
    [(b"", {}), (WRONG_SUM, {CHECKSUM: len(WRONG_SUM)}), (b"noise", {NOISE: 5}), (bytes(9), {FrameParser.PADDING: 9})],
)
@pytest.mark.parametrize("end", [b"", GOOD[:3], GOOD[:-1]])
def test_frames_in_a_row_end_at_anything_else_and_before_an_incomplete_frame(
    between: bytes, reasons: dict[str, int], end: bytes
) -> None:
    parser = acquainted(FrameParser(), [GOOD])
    assert parser.feed(GOOD * 100 + between + GOOD * 100 + end) == [FOUND] * 200
    assert parser.feed(GOOD[len(end) :]) == [FOUND]
    assert {reason: count for reason, count in parser.skipped.items() if count} == reasons


@pytest.mark.parametrize("seed", sampled(range(20), 5))
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


class ScanningParser(FrameParser):
    """The same parser without the short cut for a chunk that is one whole frame."""

    def feed(self, chunk: bytes | bytearray | memoryview) -> list[Frame]:
        return super().feed(chunk) if self._partial else self._scan(bytes(chunk))


def state(thing: Any) -> Any:
    """Return all that `thing` will ever decide by, in a form that can be compared."""
    if isinstance(thing, (FrameParser, Recovery, BlockSums)):
        return {name: state(value) for name, value in vars(thing).items() if not callable(value)}
    if isinstance(thing, dict):
        return {key: None if isinstance(value, tuple) else value for key, value in thing.items()}
    if isinstance(thing, bytearray):
        return bytes(thing)
    return [*thing] if isinstance(thing, list) else thing


def line(random: Random, byte_order: ByteOrder, damage: float) -> list[bytes]:
    """Return the pieces of a stream: whole frames, some padding, and `damage` as many damaged ones."""
    good = encode_frame(QueryServoRequest.packet_id, b"\x07", byte_order)
    dummy = partial(encode_frame, SendDummyDataRequest.packet_id, byte_order=byte_order)
    frames = [any_frame(random, byte_order) for _ in range(10)] + [good, dummy(good), dummy(bytes(9) + good[:9])]
    pieces: list[bytes] = []
    for _ in range(1500):
        pieces.append(random.choice(frames))
        chance = random.random()
        if chance < damage:
            head = HEADER[byte_order].pack(MAGIC, SendDummyDataRequest.packet_id, 8)
            lucky = head + bytes([(good[7] - sum(head + good[:7])) % 256]) + good[:7]  # has swallowed a beginning
            pieces += random.choice(
                [[random.randbytes(9)], [good[:-1] + b"!"], [good[:-3]], [good[3:]], [lucky, good[7:]]]
            )
        elif chance > 0.98:
            pieces.append(bytes(random.randrange(1, 20)))
        elif chance > 0.975:
            pieces.append(dummy(random.randbytes(random.choice([300, 5000]))))
    return pieces


def fed(parser: FrameParser, stream: bytes, cuts: list[int]) -> Iterator[tuple[list[Frame], Any, Any, Any]]:
    """Yield frames, partial frame, skipped spans and state after each chunk and at the end."""
    for start, end in pairwise([0, *cuts, len(stream)]):
        yield parser.feed(stream[start:end]), parser.partial_frame, parser.take_skipped(), state(parser)
    yield parser.finish(), parser.partial_frame, parser.take_skipped(), state(parser)


@pytest.mark.parametrize("damage", [0, 0.002, 0.01, 0.3])
@pytest.mark.parametrize("seed", sampled(range(6), 1))
def test_any_cut_gives_the_same_and_a_whole_frame_at_once_leaves_the_same_state(seed: int, damage: float) -> None:
    random, byte_order = Random(seed), BYTE_ORDERS[seed % 2]
    pieces = line(random, byte_order, damage)
    stream, by_piece = b"".join(pieces), list(accumulate(map(len, pieces[:-1])))
    ends = []
    for cuts in [], by_piece, sorted(random.choices(range(len(stream)), k=99)), [*range(0, len(stream), 64)]:
        steps = list(fed(FrameParser(byte_order, keep_skipped=True), stream, cuts))
        assert steps == list(fed(ScanningParser(byte_order, keep_skipped=True), stream, cuts))
        recoveries = [step[-1]["_recovery"] for step in steps]
        assert all(recovery["in_sync"] for recovery in recoveries if recovery["is_calm"])
        frames = [frame for found, *_ in steps for frame in found]
        skipped = b"".join(span for _, _, spans, _ in steps for _, span, _ in spans)
        ends.append(
            (frames, skipped, recoveries[-1], *(steps[-1][-1][name] for name in ("frames", "skipped", "_wary")))
        )
    assert ends[1:] == ends[:1] * 3


@pytest.mark.parametrize("frame", [GOOD, encode_frame(SendDummyDataRequest.packet_id, bytes(255), "little")])
def test_a_whole_frame_is_not_scanned_where_nothing_else_is_under_way(
    frame: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    parser = acquainted(FrameParser(), [frame])
    monkeypatch.setattr(parser, "_scan", None)
    assert parser.feed(frame) + parser.feed(bytearray(frame)) + parser.feed(memoryview(frame)) == [
        *FrameParser().feed(frame * 3)
    ]
    assert parser.frames == 4


def test_a_frame_too_deep_to_be_searched_is_not_kept_by_the_short_cut_either() -> None:
    parser = _SearchingParser("little", deepest=0, wary=0)
    for _ in range(3):
        assert parser.feed(GOOD) == [FOUND]
        assert parser.recovery.last is None
