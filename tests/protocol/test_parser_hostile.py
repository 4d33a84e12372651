"""Hostile streams: work for each byte and memory are bounded. Work is counted, not timed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any
from zlib import adler32

import pytest

from benchmarks.streams import chunks, hostile
from servolink.protocol import frame as sums_module
from servolink.protocol import parser as parser_module
from servolink.protocol.frame import _MOST_BLOCKS, BlockSums, Frame, encode_frame
from servolink.protocol.parser import _MAX_CACHED_HEADERS, FrameParser

_LARGEST_FRAME = 65_544
_NAMES = [name for name, _ in hostile(0)]


@cache
def _streams(size: int) -> dict[str, bytes]:
    return dict(hostile(size))


class Work:
    """The work of parsers: bytes summed or copied, remembered sums used, searches for a frame start."""

    def __init__(self) -> None:
        self.bytes = 0
        self.sums = 0
        self.searches = 0

    @contextmanager
    def counted(self) -> Iterator[None]:
        """Count the work of all parsers inside the block."""
        scan, recover, sum_blocks = FrameParser._scan, FrameParser._recover, BlockSums.sum

        def counted_adler32(data: bytes, start: int = 1) -> int:
            self.bytes += len(data)
            return adler32(data, start)

        def counted_scan(parser: FrameParser, data: bytes, at: int = 0) -> list[Frame]:
            self.bytes += len(data)
            return scan(parser, data, at)

        def counted_sum(sums: BlockSums, data: bytes, start: int, end: int) -> int:
            self.sums += (end - start) // 256
            return sum_blocks(sums, data, start, end)

        def counted_recover(parser: FrameParser, *args: Any, **named: Any) -> tuple[bytes, int]:
            self.searches += 1
            return recover(parser, *args, **named)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(parser_module, "adler32", counted_adler32)
            patch.setattr(sums_module, "adler32", counted_adler32)
            patch.setattr(FrameParser, "_scan", counted_scan)
            patch.setattr(FrameParser, "_recover", counted_recover)
            patch.setattr(BlockSums, "sum", counted_sum)
            yield


@pytest.mark.parametrize("name", _NAMES)
@pytest.mark.parametrize("size", [1 << 14, 1 << 16])
def test_work_for_each_byte_has_the_same_bound_in_short_and_long_streams(name: str, size: int) -> None:
    stream, work = _streams(size)[name], Work()
    with work.counted():
        parser = FrameParser()
        for chunk in chunks(stream, 4096):
            parser.feed(chunk)
    assert work.bytes <= 100 * size
    assert work.sums <= 100 * size
    assert work.searches <= size


@pytest.mark.parametrize("name", _NAMES)
def test_the_end_costs_at_most_a_look_at_each_begun_frame(name: str) -> None:
    parser, work = FrameParser(), Work()
    parser.feed(_streams(1 << 15)[name])
    with work.counted():
        parser.finish()
    assert work.searches <= _LARGEST_FRAME // 2
    assert work.bytes <= _LARGEST_FRAME * (work.searches + 1)


@pytest.mark.parametrize("name", _NAMES)
def test_memory_is_bounded(name: str) -> None:
    parser = FrameParser()
    most = 0
    for chunk in chunks(_streams(1 << 16)[name], 1000):
        parser.feed(chunk)
        most = max(most, len(parser._partial))
        assert len(parser._entries) <= _MAX_CACHED_HEADERS
    assert most <= _LARGEST_FRAME


def test_headers_are_remembered_up_to_a_number_and_all_are_read() -> None:
    parser = FrameParser()
    for length in range(_MAX_CACHED_HEADERS + 10):
        assert parser.feed(encode_frame(10050, bytes(length % 7000), "little")) == [(10050, bytes(length % 7000))]
    assert 0 < len(parser._entries) <= _MAX_CACHED_HEADERS


def test_sums_of_blocks_are_forgotten() -> None:
    parser, frame = FrameParser(), encode_frame(10050, b"\xff" * 65_535, "little")
    parser.feed(frame[:-5])
    for _ in range(40):
        assert parser.feed(frame[-5:] + frame[:-5]) == [(10050, b"\xff" * 65_535)]
        assert parser._blocks is not None
        assert len(parser._blocks._running) <= _MOST_BLOCKS + 256
    assert len(parser.feed(frame[-5:])) == 1
    assert parser._blocks is None


def test_the_longest_frame_is_not_looked_at_for_each_of_its_bytes() -> None:
    frame, work = encode_frame(10050, bytes(65_535), "little"), Work()
    with work.counted():
        parser = FrameParser()
        assert sum(len(parser.feed(frame[at : at + 1])) for at in range(len(frame))) == 1
    assert work.bytes < 5 * len(frame)
    assert work.searches < 20
