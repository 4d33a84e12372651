"""The parser against the textbook's, by frame size and chunk size, on streams of one kind, of many, and damaged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import Any

from benchmarks.goals import Goal, at_least, at_most
from benchmarks.measuring import Result, compare, table
from benchmarks.streams import MIXES, TYPICAL, chunks, dirty, mixed
from benchmarks.textbook import TextbookParser
from servolink.protocol.codec import Codec
from servolink.protocol.parser import FrameParser

CHUNKS = {"1": 1, "64": 64, "one frame": None, "4096": 4096, "65536": 65536}
"""Bytes in a chunk, by heading."""
TIMES = {"14": 2.5, "186": 3.5, "3611": 4.5}
"""How many times faster than the textbook, by frame size, in 4 KiB chunks of a clean stream of one kind."""
LONG = 1000
"""MB/s of 3.6 KB frames in the same chunks."""
LINE = 1.216
"""MB/s of a full USB line at full speed, 12 Mbit/s, the most that a board sends."""
SHARES = {("14", "64"): 4.0, ("186", "64"): 1.0, ("15 ids of 186 bytes", "4096"): 0.5, ("both in turns", "4096"): 0.5}
"""Percent of a core that such a line may take, by frames and by chunk: a packet of USB, or what waits for a program."""
AT_ONCE = 450
"""Nanoseconds for a call with one whole frame of 14 or 186 bytes of any kind, as most responses arrive."""


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
            "Frames: a button event, the state of 16 servos, a list of 100 actions; or all kinds of that size.",
            "One frame: each call gets one whole frame, as in most round trips.",
            "Damaged: one frame in 20 has a flipped bit, is cut, or has noise or padding in its place.",
        ],
    )
    return {"tables": [quote], "cases": cases, "goals": list(_goals(cases))}


def _streams(total: int) -> Iterator[tuple[str, list[bytes]]]:
    """Yield the frames of each clean stream."""
    for size, packet in TYPICAL.items():
        yield str(size), [Codec().encode(packet)] * (total // size)
    for name, sizes in MIXES.items():
        yield name, mixed(sizes, total)


def _cases(stream: str, name: str, frames: list[bytes], rounds: int) -> Iterator[dict[str, Any]]:
    whole = b"".join(frames)
    for heading, size in CHUNKS.items():
        if size is None and len(frames) == 1:
            continue  # a damaged stream has no whole frames
        pieces = frames if size is None else chunks(whole[: max(len(whole) // 16, 8192)] if size == 1 else whole, size)
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
    yield at_least("speed on 3,611 bytes, 4 KiB chunks", clean["3611", "4096"]["mb_per_s"], LONG, "{:,.0f} MB/s")
    for (frames, chunk), most in SHARES.items():
        name = f"a full USB line of 1.2 MB/s, frames of {frames}" + (" bytes" if frames.isdecimal() else "")
        share = 100 * LINE / clean[frames, chunk]["mb_per_s"]
        yield at_most(f"{name}, {chunk} bytes a chunk", share, most, "{:.2f} % of a core")
    for name, frames in {"14": "14 bytes", "186": "186 bytes", **{mix: mix for mix in MIXES}}.items():
        case = clean[name, "one frame"]
        yield at_most(f"one whole frame a call, {frames}", case["ours"] / case["frames"], AT_ONCE, "{:,.0f} ns")


def _feeding(kind: Callable[[], FrameParser | TextbookParser], pieces: list[bytes]) -> Callable[[], int]:
    """Return the work to be measured: feed the pieces and count the frames."""

    def feed() -> int:
        parse = kind().feed
        return sum(len(parse(piece)) for piece in pieces)

    return feed
