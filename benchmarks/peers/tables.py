"""The tables of the comparison."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from benchmarks.measuring import Table, table
from benchmarks.peers.damage import DAMAGES
from benchmarks.peers.ours import Ours, OursTyped
from benchmarks.peers.peer import Peer
from benchmarks.peers.row import Row

MISSING = 'not installed: pip install -e ".[bench]"'
_FEEDING = (
    "Advantage: where the comparison is unequal, and in whose favour.",
    "Ours is fed chunks of 4 KiB. One frame a call is best for the parsers that need it.",
    "A comparison that spreads over more than 10 % is measured again, twice at most; the steadiest one is shown.",
    "Parsers that read from a stream object have it in memory: a real port would cost them a system call a read.",
)
_DAMAGE = (
    "Noise: random bytes, zeros, or a part of a frame in 40 % of the gaps.",
    "Corruption: 1 % of all bytes replaced; 0.3 % in frames of about 186 bytes.",
    "A frame is intact if no byte of it is replaced; each is different from all others.",
    "False frames came out of all three and were not sent so: their checksum is right by chance, or there is none.",
    "In chunks of 64 bytes, or as the parser needs to be fed; without requests and their time-outs.",
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
        _FEEDING,
    )


def speeds(size: int, rows: Sequence[Row]) -> Table:
    """Return how fast each is on a clean stream of frames of about this size."""
    found = [(row, row.best) for row in rows if row.best is not None]
    return table(
        f"Frames of about {size:,} bytes, clean, in chunks of 4,096 bytes",
        ("parser", "bytes", "frames/s", "MB/s", "ours is faster by", "ours with typed objects by", "spread"),
        [
            _own(Ours, size, median(best.ours_ns for _, best in found)),
            _own(OursTyped, size, median(best.typed.ours for _, best in found)),
            *(
                (
                    row.peer.name,
                    f"{row.frame:,}",
                    *_rates(best.ns, row.frame),
                    _times(best.times.ratio),
                    _times(best.typed.ratio) if row.peer.builds else "-",
                    f"{best.times.spread:.0%}",
                )
                for row, best in sorted(found, key=lambda each: each[1].ns)
            ),
        ],
    )


def _own(peer: type[Peer], size: int, ns: float) -> tuple[str, ...]:
    return peer.name, f"{size:,}", *_rates(ns, size), "-", "-", "-"


def _rates(ns: float, size: int) -> tuple[str, str]:
    return f"{1e9 / ns:,.0f}", f"{size / ns * 1000:,.1f}"


def _times(ratio: float) -> str:
    return f"{ratio:.2f}x" if ratio < 10 else f"{ratio:,.0f}x"


def recalls(rows: Sequence[Row]) -> Table:
    """Return how many intact frames each finds on a damaged stream of its own format."""
    told = [
        f"{row.peer.name}, frames of {row.frame} bytes: in chunks of 64 bytes, without the pauses that it is made for, "
        f"it finds {', '.join(f'{found.share:.1%} ({kind})' for kind, found in row.back_to_back.items())}."
        for row in rows
        if row.back_to_back
    ]
    return table(
        "Intact frames found on a damaged stream",
        ("parser", "bytes", *DAMAGES, "false frames"),
        [
            (
                row.peer.name,
                f"{row.frame:,}",
                *(_share(row, kind) for kind in DAMAGES),
                f"{sum(found.false for found in row.recall.values()):,}",
            )
            for row in rows
            if row.recall
        ],
        [*_DAMAGE, *told],
    )


def _share(row: Row, kind: str) -> str:
    share = row.recall[kind].share
    return "100%" if share == 1 else f"{min(share, 0.999):.1%}"
