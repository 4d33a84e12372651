"""The compiled loops do the same as Python's with any bytes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType

from benchmarks import loading
from servolink.errors import DecodeError
from servolink.protocol import speedups as compiled
from servolink.protocol.codec import PACKETS
from servolink.protocol.frame import ByteOrder
from servolink.protocol.layout import Layout
from servolink.protocol.packet import Packet
from servolink.protocol.parser import FrameParser
from tests.fuzz.recipes import IDS, Cursor, content_for, made

_ORDERS: tuple[ByteOrder, ...] = ("little", "big")
_ENCODINGS = ("utf-8", "latin-1", "big5", "utf-16-le")


def compare(data: bytes) -> None:
    """Parse a stream and decode a content with both loops; do nothing where none can be compiled."""
    if len(data) < 3 or (module := _module()) is None:
        return
    order, encoding = _ORDERS[data[0] & 1], _ENCODINGS[data[0] >> 1 & 3]
    stream = data[2:] if data[0] & 8 else made(Cursor(data, 2), order).stream
    with _using(None):
        told = _parsed(stream, order, data[1])
    with _using(module):
        assert _parsed(stream, order, data[1]) == told
    packet_id = IDS[data[1] % len(IDS)]
    content = data[2:] if data[0] & 16 else content_for(Cursor(data, 2), packet_id, order)
    python, other = _layouts(packet_id, order)
    assert _decoded(other, content, encoding) == _decoded(python, content, encoding)


def _parsed(stream: bytes, order: ByteOrder, cuts: int) -> list[object]:
    parser, told = FrameParser(order, keep_skipped=True), list[object]()
    step = max(1 + cuts % 61, len(stream) // (64 if cuts < 16 else 3))
    for at in range(0, len(stream), step):
        told.append((parser.feed(stream[at : at + step]), parser.partial_frame, parser.take_skipped()))
    told.append((parser.finish(), parser.skipped, parser.frames))
    return told


def _decoded(layout: Layout, content: bytes, encoding: str) -> Packet | str:
    try:
        return layout.decode(content, encoding)
    except DecodeError as error:
        return str(error)


@cache
def _module() -> ModuleType | None:
    return loading.loops()[0]


@cache
def _layouts(packet_id: int, order: ByteOrder) -> tuple[Layout, Layout]:
    """Return the layout of a packet with Python's loop and with the compiled one."""
    layouts = []
    for module in (None, _module()):
        with _using(module):
            layouts.append(Layout(PACKETS[packet_id], order))
    return layouts[0], layouts[1]


@contextmanager
def _using(module: ModuleType | None) -> Iterator[None]:
    """Make parsers and new layouts use these loops; layouts made before keep theirs."""
    before = compiled.collect, compiled.read_rows
    compiled.collect = None if module is None else module.collect
    compiled.read_rows = None if module is None else module.read_rows
    try:
        yield
    finally:
        compiled.collect, compiled.read_rows = before
