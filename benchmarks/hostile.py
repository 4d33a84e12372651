"""What a stream made to hurt costs for each of its bytes: as much in a long stream as in a short one."""

from __future__ import annotations

from collections.abc import Callable
from statistics import median

from benchmarks.measuring import Result, table, timed
from benchmarks.streams import chunks, hostile
from servolink.protocol.parser import FrameParser

SIZES = (128 * 1024, 512 * 1024)
_LIMIT = 2.0  # a cost that grows with the stream would be four times as high in the longer one
_MOST = 1000.0  # ns for a byte


def run(*, short: bool) -> Result:
    """Measure both sizes in 4 KiB chunks, and the larger in one; a cost that doubles, or above 1 µs, is a failure."""
    cases, slow = [], []
    for (name, small), (_, big) in zip(hostile(SIZES[0]), hostile(SIZES[1]), strict=True):
        costs = [
            median(timed(_feeding(stream, chunk)) for _ in range(1 if short else 3)) / len(stream)
            for stream, chunk in ((small, 4096), (big, 4096), (big, len(big)))
        ]
        cases.append({"stream": name, "ns_per_byte": costs})
        if max(costs) > _LIMIT * costs[0]:
            slow.append(f"{name}: {costs[0]:.0f} ns per byte became {max(costs):.0f}")
        if max(costs) > _MOST:
            slow.append(f"{name}: {max(costs):.0f} ns per byte, the goal is {_MOST:.0f}")
    quote = table(
        "Hostile streams, ns per byte",
        ("stream", "128 KB", "512 KB", "512 KB at once"),
        [(case["stream"], *(f"{cost:.1f}" for cost in case["ns_per_byte"])) for case in cases],
    )
    return {"tables": [quote], "cases": cases, "slow": slow}


def _feeding(stream: bytes, chunk: int) -> Callable[[], None]:
    pieces = chunks(stream, chunk)

    def feed() -> None:
        parser = FrameParser()
        for piece in pieces:
            parser.feed(piece)
        parser.finish()

    return feed
