"""Many histories, and what the checker found in them."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field

from benchmarks.measuring import Result, table
from benchmarks.reliability.board import BOARDS
from benchmarks.reliability.history import STEPS, History, relive
from benchmarks.reliability.line import LINES

_COLUMNS = {
    "calls": ("calls",),
    "right": ("right",),
    "cancelled": ("cancelled",),
    "no response": ("timed out", "outcome unknown", "refused", "undecodable", "lost"),
    "wrong": ("wrong", "of a repeated answer"),
    "damage accepted": ("damage accepted",),
    "twice done": ("executed twice",),
    "lost in time": ("lost in time",),
    "missed": ("missed",),
}
"""What is shown, and the counts of which it is the sum."""
_PROGRESS = 100  # histories between two signs of life


@dataclass(slots=True)
class Survey:
    """What came of many histories."""

    histories: int = 0
    total: Counter[str] = field(default_factory=Counter)
    by_line: dict[str, Counter[str]] = field(default_factory=lambda: {line.name: Counter() for line in LINES})
    by_board: dict[str, Counter[str]] = field(default_factory=lambda: {board.name: Counter() for board in BOARDS})
    repeating: Counter[str] = field(default_factory=Counter)
    """Only boards that answer twice; they are in no other count but their own row."""
    faults: list[str] = field(default_factory=list)

    def add(self, history: History) -> None:
        """Count one more."""
        scene, counts = history.scene, history.counts
        self.histories += 1
        self.by_board[scene.board.name].update(counts)
        if scene.board.twice:
            self.repeating.update(counts)
        else:
            self.total.update(counts)
            self.by_line[scene.line.name].update(counts)
        self.faults += [f"seed {scene.seed}, {fault}" for fault in history.faults]


def survey(first: int, histories: int, steps: int = STEPS) -> Survey:
    """Live through the histories of so many seeds, from `first` on."""
    found = Survey()
    for seed in range(first, first + histories):
        found.add(relive(seed, steps))
        if found.histories % _PROGRESS == 0:
            sys.stderr.write(f"{found.histories:,} histories, {len(found.faults)} faults\n")
    return found


def run(*, short: bool, first: int = 0, histories: int | None = None, steps: int = STEPS) -> Result:
    """Survey each line with each board, unless it is said how many histories; short: with a fifth of the calls."""
    steps = steps // 5 if short else steps
    found = survey(first, len(LINES) * len(BOARDS) if histories is None else histories, steps)
    rows = [(name, *_cells(counts)) for name, counts in found.by_line.items()]
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
            "lines leave out the board that responds twice",
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
        "boards": {name: dict(counts) for name, counts in found.by_board.items()},
    }


def _cells(counts: Counter[str]) -> list[str]:
    return [f"{sum(counts[name] for name in names):,}" for names in _COLUMNS.values()]
