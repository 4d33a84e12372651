"""FrameParser finds every intact frame, however the stream is cut and damaged, and counts every other byte."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.streams import any_frame, damaged_line, hostile
from servolink.protocol.codec import Codec
from servolink.protocol.frame import HEADER, HEADER_SIZE, MAGIC, OVERHEAD, ByteOrder, Frame, encode_frame
from servolink.protocol.parser import CHECKSUM, INCOMPLETE, LENGTH, NOISE, UNKNOWN_ID, FrameParser
from servolink.protocol.servos import QueryServoRequest, QueryServoResponse
from tests.protocol.declared import VECTORS
from tests.tables import over

DUMMY, ASK = 10050, QueryServoRequest.packet_id
GOOD = encode_frame(ASK, b"\x07", "little")
FOUND: Frame = (ASK, b"\x07")

Span = tuple[int, bytes, str]


def parsed(stream: bytes, cuts: list[int] | None = None) -> tuple[list[Frame], list[Span], dict[str, int]]:
    """Return all frames, the merged skipped spans with the frames before each, and the counters."""
    parser = FrameParser(keep_skipped=True)
    frames: list[Frame] = []
    spans: list[Span] = []
    at = 0
    for cut in [*(cuts or []), len(stream)]:
        before, new = len(frames), parser.feed(stream[at:cut])
        frames += new
        spans += [(before + here, data, reason) for here, data, reason in parser.take_skipped()]
        at = max(at, cut)
    before = len(frames)
    frames += parser.finish()
    spans += [(before + here, data, reason) for here, data, reason in parser.take_skipped()]
    assert parser.frames == len(frames)
    return frames, merged(spans), dict(parser.skipped)


def merged(spans: list[Span]) -> list[Span]:
    joined: list[Span] = []
    for here, data, reason in spans:
        if joined and joined[-1][0] == here and joined[-1][2] == reason:
            joined[-1] = here, joined[-1][1] + data, reason
        else:
            joined.append((here, data, reason))
    return joined


def skipped(stream: bytes) -> dict[str, int]:
    return {reason: count for reason, count in parsed(stream)[2].items() if count}


@pytest.mark.parametrize("byte_order", ["little", "big"])
def test_every_golden_frame_is_found(byte_order: ByteOrder) -> None:
    golden = [vector for vector in VECTORS if vector.byte_order == byte_order]
    parser = FrameParser(byte_order)
    frames = parser.feed(b"".join(vector.frame for vector in golden))
    assert [encode_frame(*frame, byte_order) for frame in frames] == [vector.frame for vector in golden]
    assert parser.frames == len(golden)
    assert not any(parser.skipped.values())
    assert Codec(byte_order).decode(*frames[-1]).packet_id == golden[-1].packet_id


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_any_buffer_is_taken_and_not_kept(kind: type[bytes]) -> None:
    chunk = bytearray(GOOD[:5])
    parser = FrameParser()
    assert parser.feed(kind(chunk)) == []
    chunk[:] = bytes(5)
    assert parser.feed(kind(GOOD[5:])) == [FOUND]


@pytest.mark.parametrize(
    ("before", "reasons"),
    [
        (b"", {}),
        (bytes(50), {FrameParser.PADDING: 50}),
        (b"\x01" * 50, {NOISE: 50}),
        (b"\0\0\1\0", {FrameParser.PADDING: 2, NOISE: 2}),
        (MAGIC[:3], {NOISE: 3}),
        (MAGIC, {UNKNOWN_ID: 4}),
        (HEADER["little"].pack(MAGIC, 12345, 0) + b"\xea", {UNKNOWN_ID: 9}),
        (HEADER["little"].pack(MAGIC, ASK, 2) + b"\x07\x00", {LENGTH: 10}),
        (GOOD[:-1] + bytes([GOOD[-1] ^ 1]), {CHECKSUM: 10}),
    ],
)
def test_what_is_no_frame_is_skipped_and_counted_by_reason(before: bytes, reasons: dict[str, int]) -> None:
    assert parsed(before + GOOD)[0] == [FOUND]
    assert skipped(before + GOOD) == reasons


def test_padding_after_a_frame_is_no_noise() -> None:
    frames, spans, _ = parsed(GOOD + bytes(54) + GOOD)
    assert frames == [FOUND, FOUND]
    assert spans == [(1, bytes(54), FrameParser.PADDING)]


def test_a_frame_inside_a_damaged_one_is_found() -> None:
    outer = encode_frame(DUMMY, b"ab" + GOOD + b"cd", "little")
    assert parsed(outer)[0] == [(DUMMY, b"ab" + GOOD + b"cd")]
    assert parsed(outer[:-1] + bytes([outer[-1] ^ 1]))[0] == [FOUND]


def test_a_frame_swallowed_by_a_cut_one_is_found() -> None:
    cut = encode_frame(DUMMY, bytes(range(1, 40)), "little")[:20]
    frames, _, counts = parsed(cut + GOOD * 8)
    assert frames == [FOUND] * 8
    assert counts[CHECKSUM] == len(cut)


def swallowing(swallowed: bytes, checksum: int) -> bytes:
    """Return a damaged frame that ends inside the next one, whose first bytes happen to be its right sum."""
    head = HEADER["little"].pack(MAGIC, DUMMY, 1 + len(swallowed))
    return head + bytes([(checksum - sum(head) - sum(swallowed)) % 256]) + swallowed


def test_a_frame_whose_beginning_was_swallowed_by_chance_is_found_when_sync_is_lost() -> None:
    false = swallowing(GOOD[:7], checksum=GOOD[7])
    frames, spans, _ = parsed(false + GOOD[7:] + GOOD)
    assert frames == [(DUMMY, false[8:]), FOUND, FOUND]
    assert spans == []


def test_looking_back_is_done_only_after_a_loss_of_sync() -> None:
    content = b"ab" + GOOD + b"cd"
    holding = encode_frame(DUMMY, content, "little")
    assert parsed(holding * 3)[0] == [(DUMMY, content)] * 3
    assert parsed(holding + b"\x01")[0] == [(DUMMY, content), FOUND]


def test_a_frame_found_by_looking_back_is_looked_into_too() -> None:
    inner = encode_frame(DUMMY, GOOD, "little")
    false = swallowing(inner[:12], checksum=inner[12])
    frames, _, _ = parsed(false + inner[12:] + b"\x01")
    assert frames == [(DUMMY, false[8:]), (DUMMY, GOOD), FOUND]


def stairs(steps: int, size: int = 120) -> tuple[bytes, list[Frame]]:
    """Return a stream of frames that each begin inside the one before and end in noise, and the frames."""
    stream = bytearray()
    for step in range(steps):
        stream += HEADER["little"].pack(MAGIC, DUMMY, size - OVERHEAD - 6 * step)
    stream += bytes(size - len(stream) - 1)
    ends = []
    for step in range(steps):
        stream.append(sum(stream[HEADER_SIZE * step :]) % 256)
        ends.append(len(stream))
        stream.append(1)
    return bytes(stream), [(DUMMY, bytes(stream[8 * at + 8 : end - 1])) for at, end in enumerate(ends)]


@pytest.mark.parametrize("step", [1, 7, 64, 1000])
def test_what_looking_back_finds_is_looked_into_up_to_four_times(step: int) -> None:
    stream, frames = stairs(8)
    parser = FrameParser()
    twice = stream + stream
    found = [frame for at in range(0, len(twice), step) for frame in parser.feed(twice[at : at + step])]
    assert found == frames[:5] * 2
    last = encode_frame(*frames[4], "little")
    assert parser.skipped == dict.fromkeys(FrameParser.REASONS, 0) | {NOISE: 2 * len(stream.partition(last)[2])}


def test_a_long_frame_is_looked_into_when_it_has_left_the_buffer() -> None:
    inner = encode_frame(DUMMY, bytes(range(1, 256)) * 40, "little")
    false = swallowing(inner[:9000], checksum=inner[9000])
    parser = FrameParser()
    assert parser.feed(false) + parser.feed(inner[9000:9001]) == [(DUMMY, false[8:])]
    assert parser.feed(inner[9001:]) == [(DUMMY, inner[8:-1])]


def test_the_bytes_behind_a_frame_in_another_are_read_no_more_often_for_it() -> None:
    begun = HEADER["little"].pack(MAGIC, DUMMY, 50)
    holding = encode_frame(DUMMY, (encode_frame(DUMMY, begun, "little") + b"noise") * 6 + GOOD, "little")
    assert parsed(holding + b"noise")[0][-1] == FOUND


ENDS_IN_ZEROS = encode_frame(DUMMY, bytes([-sum(HEADER["little"].pack(MAGIC, DUMMY, 6)) % 256]) + bytes(5), "little")


def test_the_zeros_at_the_end_of_a_swallowed_frame_are_not_taken_for_padding() -> None:
    assert ENDS_IN_ZEROS.endswith(bytes(6))
    false = swallowing(ENDS_IN_ZEROS[:10], checksum=0)
    for more in (b"", bytes(100), bytes(70_000)):
        frames, _, _ = parsed(false + ENDS_IN_ZEROS[10:] + more + GOOD)
        assert frames == [(DUMMY, false[8:]), (DUMMY, ENDS_IN_ZEROS[8:-1]), FOUND]


@pytest.mark.parametrize("step", [1, 1000])
def test_padding_behind_a_frame_with_a_whole_one_inside_decides_nothing_and_noise_does(step: int) -> None:
    inside = encode_frame(10040, b"", "little")
    outside = encode_frame(10050, inside, "little")
    for behind, noise in ((inside, 0), (b"noise", 5)):
        stream = outside + bytes(5) + behind
        parser = FrameParser()
        frames = [frame for at in range(0, len(stream), step) for frame in parser.feed(stream[at : at + step])]
        assert [packet_id for packet_id, _ in frames] == [10050, 10040]
        assert (parser.skipped[FrameParser.PADDING], parser.skipped[NOISE]) == (5, noise)


def test_whole_frames_swallowed_by_chance_are_found_on_a_noisy_line() -> None:
    begun = HEADER["little"].pack(MAGIC, DUMMY, 900)
    for after in (b"", b"xyz", bytes(3), begun[:3], begun):
        false = swallowing(GOOD + GOOD + after, checksum=0) + b"\0"
        assert parsed(b"noise" + false + GOOD)[0] == [(DUMMY, false[8:-1]), FOUND, FOUND, FOUND]
        assert parsed(false + GOOD)[0] == [(DUMMY, false[8:-1]), FOUND]


def test_on_a_noisy_line_too_each_swallowed_frame_comes_once() -> None:
    false = swallowing(GOOD + GOOD[:6], checksum=GOOD[6])
    assert parsed(b"noise" + false + GOOD[6:] + b"noise" + GOOD)[0] == [(DUMMY, false[8:]), FOUND, FOUND, FOUND]


def test_a_line_is_noisy_no_longer_after_many_good_frames() -> None:
    false = swallowing(GOOD, checksum=0) + b"\0"
    assert parsed(b"noise" + GOOD * 300 + false + GOOD)[0] == [FOUND] * 300 + [(DUMMY, false[8:-1]), FOUND]


def test_the_empty_parser_and_the_empty_chunk() -> None:
    parser = FrameParser()
    assert parser.feed(b"") == parser.abandon_frame() == parser.finish() == []
    assert parser.take_skipped() == []
    assert parser.partial_frame is None
    assert parser.feed(GOOD) == [FOUND]


def test_begun_tells_of_the_frame_that_is_being_received() -> None:
    frame = encode_frame(DUMMY, bytes(100), "little")
    parser = FrameParser()
    states = []
    for start, end in ((0, 7), (7, 30), (30, 109)):
        parser.feed(frame[start:end])
        states.append(parser.partial_frame)
    assert states == [None, (DUMMY, 30, 109), None]


def test_giving_up_frees_the_frames_that_a_false_length_held_back() -> None:
    held_back = HEADER["little"].pack(MAGIC, DUMMY, 5000) + GOOD * 3
    parser = FrameParser()
    assert parser.feed(held_back) == []
    assert parser.abandon_frame() == [FOUND] * 3
    assert parser.skipped[INCOMPLETE] == 8
    assert parser.abandon_frame() == []
    assert parser.feed(GOOD) == [FOUND]


def test_giving_up_keeps_a_frame_that_has_claimed_no_length_yet() -> None:
    parser = FrameParser()
    parser.feed(GOOD[:7])
    assert parser.abandon_frame() == []
    assert parser.feed(GOOD[7:]) == [FOUND]


def test_finish_accounts_for_what_never_ended() -> None:
    frames, spans, _ = parsed(GOOD + GOOD[:-1])
    assert frames == [FOUND]
    assert spans == [(1, GOOD[:-1], INCOMPLETE)]
    assert parsed(GOOD[:3])[1] == [(0, GOOD[:3], INCOMPLETE)]
    nested = HEADER["little"].pack(MAGIC, DUMMY, 900) + GOOD + HEADER["little"].pack(MAGIC, DUMMY, 800) + GOOD
    frames, spans, _ = parsed(nested)
    assert frames == [FOUND, FOUND]
    assert spans == [(0, nested[:8], INCOMPLETE), (1, nested[18:26], INCOMPLETE)]


def test_skipped_bytes_are_kept_only_when_asked_for() -> None:
    parser = FrameParser()
    parser.feed(b"noise" + GOOD)
    assert parser.take_skipped() == []
    assert parser.skipped[NOISE] == 5


def test_a_parser_of_the_other_byte_order_sees_unknown_ids() -> None:
    parser = FrameParser("big")
    assert parser.feed(GOOD * 3) == []
    assert parser.skipped[UNKNOWN_ID] == 30


_pieces = st.one_of(
    st.just(GOOD),
    st.builds(lambda seed: any_frame(Random(seed), "little"), st.integers(0, 500)),
    st.builds(lambda content: encode_frame(DUMMY, content, "little"), st.binary(max_size=30)),
    st.builds(lambda inner, more: encode_frame(DUMMY, more + inner, "little"), st.just(GOOD), st.binary(max_size=3)),
    st.binary(max_size=20),
    st.integers(1, 40).map(bytes),
    st.integers(1, 4).map(lambda size: MAGIC[:size]),
    st.builds(lambda length: HEADER["little"].pack(MAGIC, DUMMY, length), st.integers(0, 60)),
)


@st.composite
def streams(draw: st.DrawFn) -> bytes:
    """Draw streams of whole, cut and damaged frames, with noise and padding between them."""
    return b"".join(draw(_treated(piece)) for piece in draw(st.lists(_pieces, min_size=1, max_size=8)))


@st.composite
def _treated(draw: st.DrawFn, piece: bytes) -> bytes:
    kind = draw(st.integers(0, 5))
    if not piece or kind > 1:
        return piece
    at = draw(st.integers(0, len(piece) - 1))
    return piece[:at] if kind else piece[:at] + bytes([piece[at] ^ 1 << draw(st.integers(0, 7))]) + piece[at + 1 :]


@given(streams(), st.data())
def test_cutting_changes_neither_frames_nor_what_is_skipped(stream: bytes, data: st.DataObject) -> None:
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=10)))
    whole = parsed(stream)
    assert parsed(stream, cuts) == whole
    assert parsed(stream, list(range(len(stream)))) == whole


@over("seed", range(12))
@over("step", [1, 3, 64, 4096])
def test_cutting_changes_nothing_on_a_damaged_line(seed: int, step: int) -> None:
    stream, _ = damaged_line(Random(seed), 60, "little")
    assert parsed(stream, list(range(step, len(stream), step))) == parsed(stream)


@pytest.mark.parametrize(("name", "stream"), list(hostile(8192)))
def test_cutting_changes_nothing_on_a_hostile_stream(name: str, stream: bytes) -> None:
    assert parsed(stream, list(range(1, len(stream), 7))) == parsed(stream), name


@given(st.lists(st.builds(lambda seed: any_frame(Random(seed), "little"), st.integers(0, 2000)), max_size=12))
def test_frames_after_frames_are_all_found_and_nothing_else(frames: list[bytes]) -> None:
    found, spans, _ = parsed(b"".join(frames))
    assert [encode_frame(*frame, "little") for frame in found] == frames
    assert spans == []


@given(streams())
def test_frames_and_skipped_spans_make_up_the_stream(stream: bytes) -> None:
    frames, spans, _ = parsed(stream)
    pieces = [encode_frame(*frame, "little") for frame in frames]
    for here, data, _ in reversed(spans):
        pieces.insert(here, data)
    whole = b"".join(pieces)
    # Only frames found by looking back, inside a frame believed before, make it longer.
    assert whole == stream or len(whole) > len(stream)


@given(st.binary(max_size=400))
def test_any_bytes_are_taken(stream: bytes) -> None:
    frames, spans, counts = parsed(stream)
    assert (
        sum(counts.values())
        == sum(len(data) for _, data, _ in spans)
        >= len(stream) - sum(len(content) + 9 for _, content in frames)
    )


def test_a_stream_of_typed_packets_end_to_end() -> None:
    parser, codec = FrameParser("big"), Codec("big")
    packets = [QueryServoRequest(3), QueryServoResponse()]
    frames = parser.feed(b"".join(map(codec.encode, packets)))
    assert [codec.decode(*frame) for frame in frames] == packets
