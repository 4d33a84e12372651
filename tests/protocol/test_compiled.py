"""The compiled loops do the same as Python's: frames, skipped spans, state of the parser, packets."""

from __future__ import annotations

import gc
import os
import re
import sys
import tracemalloc
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import loading
from benchmarks.samples import samples
from benchmarks.streams import damaged_line, hostile
from servolink.errors import DecodeError
from servolink.protocol.codec import PACKETS, Codec
from servolink.protocol.frame import HEADER, HEADER_SIZE, MAGIC, BlockSums, ByteOrder, Frame, encode_frame
from servolink.protocol.layout import Layout
from servolink.protocol.packet import Packet
from servolink.protocol.parser import FrameParser
from servolink.protocol.records import Step
from servolink.protocol.recovery import Recovery
from servolink.protocol.servos import ServoState
from tests import processes
from tests.protocol import uncompiled
from tests.protocol.test_parser import streams


@pytest.fixture(scope="session")
def fast() -> Any:
    """Return the compiled module: the installed one, or one compiled now."""
    module, origin = loading.loops()
    return module or pytest.skip(f"nothing can be compiled here: {origin}")


@pytest.fixture(scope="session", params=["stand-in", "compiled"])
def loops(request: pytest.FixtureRequest) -> Any:
    """Return a stand-in in Python, and the loops in C: the callers are tested without a compiler too."""
    return uncompiled if request.param == "stand-in" else request.getfixturevalue("fast")


def state(thing: Any) -> Any:
    """Return the whole state of `thing`, in a form that can be compared."""
    if isinstance(thing, (FrameParser, Recovery, BlockSums)):
        return {name: state(value) for name, value in vars(thing).items() if not callable(value)}
    if isinstance(thing, dict):
        return {key: None if isinstance(value, tuple) else value for key, value in thing.items()}
    return bytes(thing) if isinstance(thing, bytearray) else thing


def history(stream: bytes, cuts: list[int], loops: Any, byte_order: ByteOrder = "little") -> list[Any]:
    """Return frames, skipped spans and state of a parser after each chunk and at the end."""
    parser, told, at = FrameParser(byte_order, keep_skipped=True), list[Any](), 0
    with loading.using(loops):
        for cut in [*cuts, len(stream)]:
            told.append((parser.feed(stream[at:cut]), parser.partial_frame, state(parser), parser.take_skipped()))
            at = max(at, cut)
        told.append((parser.abandon_frame(), parser.finish(), state(parser), parser.take_skipped()))
    return told


@given(streams(), st.data())
def test_a_parser_does_the_same_with_any_stream_however_it_is_cut(
    loops: Any, stream: bytes, data: st.DataObject
) -> None:
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    assert history(stream, cuts, loops) == history(stream, cuts, None)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("step", [1, 64, 1000, 100_000])
def test_a_parser_does_the_same_on_a_damaged_line(loops: Any, seed: int, step: int) -> None:
    byte_order: ByteOrder = "big" if seed % 2 else "little"
    stream, _ = damaged_line(Random(seed), 60, byte_order)
    cuts = list(range(step, len(stream), step))
    assert history(stream, cuts, loops, byte_order) == history(stream, cuts, None, byte_order)


@pytest.mark.parametrize(("name", "stream"), list(hostile(8192)))
def test_a_parser_does_the_same_with_streams_made_to_hurt(loops: Any, name: str, stream: bytes) -> None:
    cuts = list(range(977, len(stream), 977))
    assert history(stream, cuts, loops) == history(stream, cuts, None), name


@given(st.integers(0, 500), st.integers(0, 40), st.integers(0, 5))
def test_frames_are_collected_up_to_what_needs_a_closer_look(fast: Any, seed: int, at: int, wary: int) -> None:
    stream, _ = damaged_line(Random(seed), 10, "little")
    parser = FrameParser()
    parser.feed(stream)
    found: list[tuple[int, list[Frame]]] = []
    for loop in (uncompiled.collect, fast.collect):
        frames: list[Frame] = [(1, b"")]
        found.append((loop(stream, at, parser._entries, frames, wary), frames))
    assert found[0] == found[1]


DUMMY = 10050
GOOD, SMALL, ROOMY, ENDS_IN_MAGIC, LONG = (
    encode_frame(DUMMY, content, "little")
    for content in (b"good", MAGIC + b"abc", MAGIC + b"abcd", MAGIC[:1] + b"abc" + MAGIC, bytes(5000))
)
ENDS_IN_ZERO = encode_frame(DUMMY, bytes([-sum(HEADER["little"].pack(MAGIC, DUMMY, 1)) % 256]), "little")


@pytest.mark.parametrize(
    ("data", "wary", "collected"),
    [
        (GOOD * 20, 0, 20),
        (GOOD + ROOMY, 0, 2),
        (GOOD + ROOMY, 1, 2),
        (GOOD + ROOMY, 2, 1),
        (GOOD + SMALL, 2, 2),
        (GOOD + ENDS_IN_MAGIC, 2, 1),
        (GOOD + LONG + GOOD, 0, 1),
        (GOOD + ENDS_IN_ZERO, 0, 2),
        (GOOD + ENDS_IN_ZERO[:-1], 0, 1),
        (GOOD + GOOD[:7], 0, 1),
        (GOOD + b"\0" + GOOD, 0, 1),
        (GOOD + GOOD[:-1] + b"x", 0, 1),
        (b"", 0, 0),
    ],
)
def test_collecting_ends_where_a_closer_look_is_needed(loops: Any, data: bytes, wary: int, collected: int) -> None:
    parser, frames = FrameParser(), list[Frame]()
    parser.feed(GOOD + SMALL + ROOMY + ENDS_IN_MAGIC + LONG + ENDS_IN_ZERO)
    end = loops.collect(data, 0, parser._entries, frames, wary)
    assert frames == FrameParser().feed(data[:end])
    assert len(frames) == collected


BYTE_ORDERS: tuple[ByteOrder, ...] = ("little", "big")
CONTENTS = [
    (packet.packet_id, Codec(order).encode(packet)[HEADER_SIZE:-1], order)
    for order in BYTE_ORDERS
    for packet in samples()
]


def decoded(layout: Layout, content: Any, encoding: str) -> Packet | str:
    try:
        return layout.decode(content, encoding)
    except DecodeError as error:
        return str(error)


@pytest.mark.parametrize(("packet_id", "content", "byte_order"), CONTENTS)
def test_any_content_is_the_same_packet(loops: Any, packet_id: int, content: bytes, byte_order: ByteOrder) -> None:
    random, layouts = Random(packet_id), []
    for each in (loops, None):
        with loading.using(each):
            layouts.append(Layout(PACKETS[packet_id], byte_order))
    noise = bytes(byte if random.random() < 0.5 else random.randrange(256) for byte in content)
    begin = layouts[0].rule.base
    for tried in (content, content[:begin] + noise[begin:], noise, content[:-1], b"", bytearray(content)):
        for encoding in ("utf-8", "big5", "utf-16-le"):
            assert decoded(layouts[0], tried, encoding) == decoded(layouts[1], tried, encoding)


def test_without_a_compiler_it_is_said_what_to_do(tmp_path: Path) -> None:
    command = [sys.executable, "hatch_build.py", str(tmp_path)]
    done = processes.run(command, cwd=Path(__file__).parents[2], env={**os.environ, "CC": "no-such-compiler"})
    assert done.returncode == 1
    assert re.search("Install a C compiler .*, or leave SERVOLINK_COMPILE unset", done.stderr)


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        ((b"", 0, {}, []), TypeError),
        ((bytearray(), 0, {}, [], 0), TypeError),
        ((b"", 0, [], [], 0), TypeError),
        ((b"", 0, {}, (), 0), TypeError),
        ((b"", "0", {}, [], 0), TypeError),
        ((b"", 0, {}, [], None), TypeError),
        ((b"", -1, {}, [], 0), ValueError),
        ((b"", 1 << 70, {}, [], 0), OverflowError),
        ((bytes(9), 0, {bytes(8): 1}, [], 0), TypeError),
        ((bytes(9), 0, {bytes(8): (8, 1, 0)}, [], 0), TypeError),
        ((bytes(9), 0, {bytes(8): ("8", 1, 0, None)}, [], 0), TypeError),
        ((bytes(9), 0, {bytes(8): (7, 1, 0, None)}, [], 0), ValueError),
        ((bytes(9), 0, {bytes(8): (-9, 1, 0, None)}, [], 0), ValueError),
    ],
)
def test_collecting_refuses_what_makes_no_sense(fast: Any, arguments: tuple[Any, ...], fault: type[Exception]) -> None:
    with pytest.raises(fault):
        fast.collect(*arguments)


def test_collecting_from_behind_the_end_finds_nothing(fast: Any) -> None:
    frames: list[Frame] = []
    assert fast.collect(bytes(9), 100, {bytes(8): (8, 1, 0, None)}, frames, 0) == 100
    assert fast.collect(bytes(9), 0, {bytes(8): (sys.maxsize, 1, 0, None)}, frames, 0) == 0
    assert frames == []


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        ((b"", 0, "<B", None), TypeError),
        (("", 0, "<B", None, "utf-8"), TypeError),
        ((b"", 0, b"<B", None, "utf-8"), TypeError),
        ((b"", 0, "<B", None, b"utf-8"), TypeError),
        ((b"", None, "<B", None, "utf-8"), TypeError),
        ((b"", -1, "<B", None, "utf-8"), ValueError),
        ((b"", 1, "<B", None, "utf-8"), ValueError),
        ((b"123", 0, "<H", None, "utf-8"), ValueError),
        ((b"12", 0, "", None, "utf-8"), ValueError),
        ((b"12", 0, "<", None, "utf-8"), ValueError),
        ((b"12", 0, "<q", None, "utf-8"), ValueError),
        ((b"12", 0, "<2", None, "utf-8"), ValueError),
        ((b"12", 0, "<s", None, "utf-8"), ValueError),
        ((b"12", 0, "<" + "B" * 17, None, "utf-8"), ValueError),
        ((b"12", 0, "<99999999999999999999s", None, "utf-8"), ValueError),
        ((b"12", 0, "<\udcff", None, "utf-8"), UnicodeEncodeError),
        ((b"12", 0, "<2s", None, "no such encoding"), LookupError),
        ((b"12", 0, "<B", 7, "utf-8"), TypeError),
        ((b"12", 0, "<B", Step, "utf-8"), TypeError),
    ],
)
def test_reading_refuses_what_makes_no_sense(fast: Any, arguments: tuple[Any, ...], fault: type[Exception]) -> None:
    with pytest.raises(fault):
        fast.read_rows(*arguments)


def test_nothing_is_leaked_or_freed_too_often(fast: Any) -> None:
    frame = Codec().encode(samples()[0]) * 50
    parser, packet_id = FrameParser(), 10**9
    parser.feed(frame)
    known = {header: (entry[0], packet_id, *entry[2:]) for header, entry in parser._entries.items()}
    state_of_16 = bytes(range(11)) * 16

    def work() -> None:
        frames: list[Frame] = []
        assert fast.collect(frame, 0, known, frames, 3) == len(frame)
        assert len(fast.read_rows(state_of_16, 0, "<BhhhhBB", ServoState, "utf-8")) == 16
        assert fast.read_rows(b"wave\0\xff", 0, ">6s", None, "utf-8") == ("wave",)
        for broken in ({bytes(8): 1}, {bytes(8): (7, 1, 0, None)}):
            with pytest.raises((TypeError, ValueError)):
                fast.collect(bytes(9), 0, broken, frames, 0)
        with pytest.raises(TypeError):
            fast.read_rows(b"12", 0, ">BB", Step, "utf-8")

    work()
    references = sys.getrefcount(packet_id)
    gc.collect()
    tracemalloc.start()
    try:
        work()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(300):
            work()
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] - before < 2000
    finally:
        tracemalloc.stop()
    assert sys.getrefcount(packet_id) == references
