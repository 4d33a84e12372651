"""The parser against the textbook's, by frame size and chunk size, on clean and on dirty streams."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict

from benchmarks.measuring import Result, compare, table
from benchmarks.streams import TYPICAL, chunks, clean, dirty
from benchmarks.textbook import TextbookParser
from servolink.protocol.parser import FrameParser

CHUNKS = (1, 64, 4096, 65536)
GOALS = {14: 2.5, 186: 3.5, 3611: 4.5}
"""How many times faster than the textbook, by frame size, in 4 KiB chunks of a clean stream."""
LONG = 1000
"""MB/s of 3.6 KB frames in the same chunks."""


def run(*, short: bool) -> Result:
    """Measure every case; a goal missed is a failure."""
    rounds, total = (3, 1 << 17) if short else (9, 1 << 22)
    cases, slow = [], []
    for kind, stream_of in (("clean", clean), ("dirty", dirty)):
        for size in TYPICAL:
            for chunk in CHUNKS:
                stream = stream_of(size, total if chunk > 1 else total // 16)
                found = compare(_feeding(FrameParser, stream, chunk), _feeding(TextbookParser, stream, chunk), rounds)
                frames = _feeding(FrameParser, stream, chunk)()
                speed = len(stream) / found.ours * 1000
                case = {"stream": kind, "frame": size, "chunk": chunk, "frames": frames, "mb_per_s": speed}
                cases.append({**case, **asdict(found)})
                if kind == "clean" and chunk == 4096 and found.ratio < GOALS[size]:
                    slow.append(f"{found.ratio:.2f}x on {size}-byte frames, the goal is {GOALS[size]}x")
                if kind == "clean" and chunk == 4096 and size == 3611 and speed < LONG:
                    slow.append(f"{speed:.0f} MB/s on {size}-byte frames, the goal is {LONG}")
    quote = table(
        "Parser against textbook parser, by bytes in a frame and in a chunk",
        ("stream", "frame", "chunk", "ours ns/frame", "ours MB/s", "textbook ns/frame", "ratio", "spread"),
        [
            (
                *(case[key] for key in ("stream", "frame", "chunk")),
                f"{case['ours'] / case['frames']:,.0f}",
                f"{case['mb_per_s']:,.1f}",
                f"{case['theirs'] / case['frames']:,.0f}",
                f"{case['ratio']:.2f}x",
                f"{case['spread']:.0%}",
            )
            for case in cases
        ],
    )
    return {"tables": [quote], "cases": cases, "goals": GOALS, "slow": slow}


def _feeding(kind: Callable[[], FrameParser | TextbookParser], stream: bytes, chunk: int) -> Callable[[], int]:
    """Return the work to be measured: feed all of `stream` and count the frames."""
    pieces = chunks(stream, chunk)

    def feed() -> int:
        parse = kind().feed
        return sum(len(parse(piece)) for piece in pieces)

    return feed
