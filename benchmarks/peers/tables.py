"""The tables of the comparison."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import median

from benchmarks.measuring import Table, table
from benchmarks.peers.ours import Ours, OursTyped
from benchmarks.peers.peer import SIZES, Peer
from benchmarks.peers.row import Row

MISSING = 'not installed: pip install -e ".[bench]"'
_NOTES = (
    "Frames of about these sizes; in chunks of 4,096 bytes, or one frame a call where a parser needs it.",
    "Found: intact frames, with noise, zeros or parts of frames in 40 % of the gaps and 1 % of all bytes replaced.",
    "Parsers that read from a stream object have it in memory: a real port would cost them a system call a read.",
)
_FED = {"chunks": "chunks", "frames": "one frame a call", "stream": "a stream object"}


def who(peers: Sequence[type[Peer]], missing: Sequence[str]) -> Table:
    """Return what each parser does, so that the others can be read fairly."""
    everybody: list[type[Peer]] = [Ours, OursTyped, *peers]
    return table(
        "What each parser does for a frame, and how it is fed",
        ("parser", "for each frame", "continues after a bad frame at", "fed", "advantage"),
        [
            *((peer.name, peer.work, peer.resync, _FED[peer.feeding], peer.fairness) for peer in everybody),
            *((name, MISSING, "-", "-", "-") for name in missing),
        ],
        [],
    )


def results(ours: Sequence[Row], rows: Sequence[Row]) -> Table:
    """Return how fast each parser is, and how many intact frames it finds, by frame size."""
    names = dict.fromkeys(row.peer for row in sorted(rows, key=_time) if row.best)
    whats = ("frames/s", "ours is faster by", "with objects by", "found")
    return table(
        "Frames parsed per second on a clean line, and intact frames found on a damaged one",
        ("parser", *(f"{size} bytes: {what}" for size in SIZES for what in whats)),
        [
            (Ours.name, *(cell for row in ours for cell in (_own(rows, row, "times"), "-", "-", _found(row)))),
            (OursTyped.name, *(cell for row in ours for cell in (_own(rows, row, "typed"), "-", "-", _found(row)))),
            *((peer.name, *(cell for size in SIZES for cell in _cells(rows, peer, size))) for peer in names),
        ],
        _NOTES,
    )


def _time(row: Row) -> tuple[int, float]:
    return row.size, row.best.ns if row.best else 0.0


def _own(rows: Sequence[Row], ours: Row, side: str) -> str:
    """Return the frames per second of ours beside all others."""
    times = [getattr(row.best, side).ours for row in rows if row.best and row.size == ours.size]
    return f"{1e9 / median(times):,.0f}" if times else "-"


def _cells(rows: Sequence[Row], peer: type[Peer], size: int) -> Iterator[str]:
    row = next((row for row in rows if (row.peer, row.size) == (peer, size)), None)
    if row is None or row.best is None:
        yield from ("-",) * 4
        return
    yield f"{1e9 / row.best.ns:,.0f}"
    yield _times(row.best.times.ratio)
    yield _times(row.best.typed.ratio) if peer.builds else "-"
    yield _found(row)


def _times(ratio: float) -> str:
    return f"{ratio:.2f}x" if ratio < 10 else f"{ratio:,.0f}x"


def _found(row: Row) -> str:
    share = row.recall["both"].share
    return "100%" if share == 1 else f"{min(share, 0.999):.1%}"
