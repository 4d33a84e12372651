"""The parser against the textbook's, by frame size and chunk size, on clean and damaged streams."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import Any

from benchmarks.goals import Goal, at_least
from benchmarks.measuring import Result, compare, table
from benchmarks.streams import TYPICAL, chunks, dirty
from benchmarks.textbook import TextbookParser
from servolink.protocol.codec import Codec
from servolink.protocol.parser import FrameParser

CHUNKS = {"one frame": None, "4096": 4096}
"""Bytes in a chunk, by heading."""
TIMES = {"14": 2.5, "186": 3.5, "3611": 4.5}
"""How many times faster than the textbook, by frame size, in 4 KiB chunks of a clean stream of one kind."""


def run(*, short: bool) -> Result:
    """Measure every case."""
    rounds, total = (1, 1 << 15) if short else (7, 1 << 20)
    cases = [case for name, frames in _streams(total) for case in _cases("clean", name, frames, rounds)]
    cases += [case for size in TYPICAL for case in _cases("damaged", str(size), [dirty(size, total)], rounds)]
    quote = table(
        "Parser against textbook parser, by bytes in a frame and in a chunk",
        ("stream", "frames", "chunk", "ours ns/frame", "ours MB/s", "textbook ns/frame", "ratio", "spread"),
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
        [
            "Frames: a button event, the state of 16 servos, a list of 100 actions.",
            "One frame: each call gets one whole frame, as in most round trips.",
            "Damaged: one frame in 20 has a flipped bit, is cut, or has noise or padding in its place.",
        ],
    )
    return {"tables": [quote], "cases": cases, "goals": list(_goals(cases))}


def _streams(total: int) -> Iterator[tuple[str, list[bytes]]]:
    """Yield the frames of each clean stream."""
    for size, packet in TYPICAL.items():
        yield str(size), [Codec().encode(packet)] * (total // size)


def _cases(stream: str, name: str, frames: list[bytes], rounds: int) -> Iterator[dict[str, Any]]:
    whole = b"".join(frames)
    for heading, size in CHUNKS.items():
        if size is None and len(frames) == 1:
            continue  # a damaged stream has no whole frames
        pieces = frames if size is None else chunks(whole, size)
        found = compare(_feeding(FrameParser, pieces), _feeding(TextbookParser, pieces), rounds)
        yield {
            "stream": stream,
            "frame": name,
            "chunk": heading,
            "frames": _feeding(FrameParser, pieces)(),
            "mb_per_s": sum(map(len, pieces)) / found.ours * 1000,
            **asdict(found),
        }


def _goals(cases: list[dict[str, Any]]) -> Iterator[Goal]:
    clean = {(case["frame"], case["chunk"]): case for case in cases if case["stream"] == "clean"}
    for size, times in TIMES.items():
        yield at_least(f"textbook parser, {size} bytes, 4 KiB chunks", clean[size, "4096"]["ratio"], times)


def _feeding(kind: Callable[[], FrameParser | TextbookParser], pieces: list[bytes]) -> Callable[[], int]:
    """Return the work to be measured: feed the pieces and count the frames."""

    def feed() -> int:
        parse = kind().feed
        return sum(len(parse(piece)) for piece in pieces)

    return feed
