"""Many histories, and what the checker found in them; as many at once as there are processors."""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial

from benchmarks.measuring import Result, table
from tests.proofs.reliability.history import STEPS, relive
from tests.proofs.reliability.stage import Scene

_COLUMNS = {
    "calls": ("calls",),
    "right": ("right",),
    "cancelled": ("cancelled",),
    "no response": ("timed out", "outcome unknown", "refused", "undecodable", "lost"),
    "wrong": ("wrong", "of a repeated answer"),
    "stale": ("stale",),
    "damage accepted": ("damage accepted",),
    "twice done": ("executed twice",),
    "beside others": ("sent beside others",),
    "lost in time": ("lost in time",),
    "missed": ("missed",),
}
"""What is shown, and the counts of which it is the sum."""
_PROGRESS = 100  # histories between two signs of life
_HISTORIES, _SHORT_HISTORIES = 5_500, 110  # of which one in five has the board that responds twice


@dataclass(slots=True)
class Survey:
    """What came of many histories."""

    histories: int = 0
    total: Counter[str] = field(default_factory=Counter)
    by_line: defaultdict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    by_board: defaultdict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    by_depth: defaultdict[int, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    by_load: defaultdict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    repeating: Counter[str] = field(default_factory=Counter)
    """Only boards that answer twice; they are in no other count but their own row."""
    faults: list[str] = field(default_factory=list)

    def add(self, seed: int, counts: Counter[str], faults: list[str]) -> None:
        """Count one more."""
        scene = Scene.of(seed)
        self.histories += 1
        self.by_board[scene.board.name].update(counts)
        if scene.board.twice:
            self.repeating.update(counts)
        else:
            self.total.update(counts)
            self.by_line[scene.line.name].update(counts)
            self.by_depth[scene.depth].update(counts)
            self.by_load[scene.load].update(counts)
        self.faults += [f"seed {seed}, {fault}" for fault in faults]


def survey(first: int, histories: int, steps: int = STEPS) -> Survey:
    """Live through the histories of so many seeds, from `first` on."""
    found = Survey()
    seeds = range(first, first + histories)
    with ProcessPoolExecutor() as processes:
        for seed, (counts, faults) in zip(
            seeds, processes.map(partial(_outcome, steps), seeds, chunksize=5), strict=True
        ):
            found.add(seed, counts, faults)
            if found.histories % _PROGRESS == 0:
                sys.stderr.write(f"{found.histories:,} histories, {len(found.faults)} faults\n")
    return found


def _outcome(steps: int, seed: int) -> tuple[Counter[str], list[str]]:
    history = relive(seed, steps)
    return history.counts, history.faults


def run(*, short: bool, first: int = 0, histories: int | None = None, steps: int = STEPS) -> Result:
    """Survey 10,000,000 calls (short: 200,000), unless it is said how many histories: each line with each board."""
    if histories is None:
        histories = _SHORT_HISTORIES if short else _HISTORIES
    found = survey(first, histories, steps)
    rows = [(name, *_cells(counts)) for name, counts in found.by_line.items()]
    rows += [(f"depth {depth}", *_cells(counts)) for depth, counts in sorted(found.by_depth.items())]
    rows += [(f"load: {name}", *_cells(counts)) for name, counts in found.by_load.items()]
    rows += [(f"board: {name}", *_cells(counts)) for name, counts in found.by_board.items()]
    quote = table(
        f"{found.histories:,} histories of {steps:,} calls, seeds {first} to {first + found.histories - 1}",
        ("line", *_COLUMNS),
        rows,
        notes=[
            "`damage accepted`: wrong responses caused by a damaged frame with the right sum",
            "`twice done`: movements, clearings and other changes that the board did more than once for one call",
            "`lost in time`: responses that arrived before their deadline and were not delivered to the caller",
            "`missed`: frames that arrived whole and were not found, most of them while there was no connection",
            "`stale`: responses to the right query, but to an earlier sending than the first one of the call",
            "`beside others`: packets that must be alone, and were sent while a response was still to come",
            "lines, depths and loads leave out the board that responds twice",
        ],
    )
    return {"tables": [quote], "wrong": found.faults[:20], "figures": figures(found)}


def figures(found: Survey) -> Result:
    """Return the sums, ready for JSON."""
    return {
        "histories": found.histories,
        "faults": len(found.faults),
        "total": dict(found.total),
        "repeating": dict(found.repeating),
        "lines": {name: dict(counts) for name, counts in found.by_line.items()},
        "depths": {str(depth): dict(counts) for depth, counts in sorted(found.by_depth.items())},
        "loads": {name: dict(counts) for name, counts in found.by_load.items()},
        "boards": {name: dict(counts) for name, counts in found.by_board.items()},
    }


def _cells(counts: Counter[str]) -> list[str]:
    return [f"{sum(counts[name] for name in names):,}" for names in _COLUMNS.values()]
