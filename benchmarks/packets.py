"""Bytes to typed packets, against the bare tuples that `struct` makes of the same contents."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from struct import Struct

from benchmarks.measuring import Result, compare, table
from benchmarks.streams import TYPICAL, chunks, clean
from servolink.protocol.codec import Codec
from servolink.protocol.frame import HEADER_SIZE
from servolink.protocol.parser import FrameParser

_RECORDS = {14: (0, Struct("<IB")), 186: (1, Struct("<BhhhhBB")), 3611: (2, Struct("<i32s"))}
"""By frame size: where the records begin in the content, and what they are."""


def run(*, short: bool) -> Result:
    """Measure decoding alone against tuples, and parser and decoder together."""
    rounds, total = (3, 1 << 16) if short else (9, 1 << 20)
    cases = []
    for size, packet in TYPICAL.items():
        stream = clean(size, total)
        count = len(stream) // size
        content = Codec().encode(packet)[HEADER_SIZE:-1]
        found = compare(_decoding(packet.packet_id, content, count), _unpacking(size, content, count), rounds)
        whole = compare(_parsing(stream), _unpacking(size, content, count), rounds)
        cases.append(
            {
                "frame": size,
                "frames": count,
                "frames_per_second": round(count / whole.ours * 1e9),
                **asdict(found),
                "times_of_tuples": 1 / found.ratio,
            }
        )
    table(
        "bytes to typed packets (parser and decoder, 4 KiB chunks), and decoding against bare tuples",
        ("frame", "packets/s", "decode ns", "tuples ns", "times", "spread"),
        [
            (
                case["frame"],
                f"{case['frames_per_second']:,}",
                *(f"{case[side] / case['frames']:.0f}" for side in ("ours", "theirs")),
                f"{case['times_of_tuples']:.2f}",
                f"{case['spread']:.0%}",
            )
            for case in cases
        ],
    )
    return {"cases": cases, "slow": []}


def _decoding(packet_id: int, content: bytes, count: int) -> Callable[[], None]:
    def decode() -> None:
        decode_one = Codec().decode
        for _ in range(count):
            decode_one(packet_id, content)

    return decode


def _unpacking(size: int, content: bytes, count: int) -> Callable[[], None]:
    start, record = _RECORDS[size]

    def unpack() -> None:
        for _ in range(count):
            list(record.iter_unpack(content[start:]))

    return unpack


def _parsing(stream: bytes) -> Callable[[], None]:
    pieces = chunks(stream, 4096)

    def parse() -> None:
        feed, decode = FrameParser().feed, Codec().decode
        for piece in pieces:
            for packet_id, content in feed(piece):
                decode(packet_id, content)

    return parse
