"""What a stream made to hurt costs for each of its bytes: as much in a long stream as in a short one."""

from __future__ import annotations

from collections.abc import Callable
from statistics import median

from benchmarks.goals import at_most
from benchmarks.measuring import Result, table, timed
from benchmarks.streams import chunks, hostile
from servolink.protocol.parser import FrameParser

SIZES = (128 * 1024, 512 * 1024)
_LIMIT = 2.0  # a cost that grows with the stream would be four times as high in the longer one
_MOST = 1000.0  # ns for a byte


def run(*, short: bool) -> Result:
    """Measure both sizes in 4 KiB chunks, and the larger in one; a cost that doubles, or above 1 µs, is a failure."""
    cases: list[tuple[str, list[float]]] = []
    for (name, small), (_, big) in zip(hostile(SIZES[0]), hostile(SIZES[1]), strict=True):
        costs = [
            median(timed(_feeding(stream, chunk)) for _ in range(1 if short else 3)) / len(stream)
            for stream, chunk in ((small, 4096), (big, 4096), (big, len(big)))
        ]
        cases.append((name, costs))
    quote = table(
        "Hostile streams, ns per byte",
        ("stream", "128 KB", "512 KB", "512 KB at once"),
        [(name, *(f"{cost:.1f}" for cost in costs)) for name, costs in cases],
    )
    growth, growing = max((max(costs) / costs[0], name) for name, costs in cases)
    most, dearest = max((max(costs), name) for name, costs in cases)
    goals = [
        at_most(f"cost of a byte in a long stream over that in a short one; most: {growing}", growth, _LIMIT),
        at_most(f"cost of a byte; most: {dearest}", most, _MOST, "{:,.0f} ns"),
    ]
    return {"tables": [quote], "cases": dict(cases), "goals": goals}


def _feeding(stream: bytes, chunk: int) -> Callable[[], None]:
    pieces = chunks(stream, chunk)

    def feed() -> None:
        parser = FrameParser()
        for piece in pieces:
            parser.feed(piece)
        parser.finish()

    return feed
