"""Programs that share a board through the hub, in many histories: up to 32 of them, some killed, the cable pulled."""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from benchmarks.measuring import Result, table
from tests.proofs.reliability.hub_history import STEPS, HubScene, relive_sharing

_HISTORIES, _SHORT_HISTORIES = 510, 150  # each number of programs on each line with each board
_SHORT_STEPS = 340
_PROGRESS = 50  # histories between two signs of life
_MUST_NOT_BE = ("wrong", "stale", "executed twice", "hung")
_COLUMNS = {
    "requests": ("requests",),
    "right": ("right",),
    "no response": ("no response", "lost"),
    "refused": ("refused",),
    "cancelled": ("cancelled",),
    "programs killed": ("killed",),
    "cable pulled": ("pulled",),
    "damage accepted": ("damage accepted",),
    "wrong": ("wrong", "of a repeated response"),
    "stale": ("stale",),
    "twice done": ("executed twice",),
    "hung": ("hung",),
}
"""What is shown, and the counts of which it is the sum."""


def run(*, short: bool, first: int = 0, histories: int | None = None, steps: int | None = None) -> Result:
    """Survey 1,000,000 requests (short: a twentieth), unless it is said how many histories."""
    steps = steps or (_SHORT_STEPS if short else STEPS)
    seeds = range(first, first + (histories or (_SHORT_HISTORIES if short else _HISTORIES)))
    by_programs: defaultdict[int, Counter[str]] = defaultdict(Counter)
    by_line: defaultdict[str, Counter[str]] = defaultdict(Counter)
    repeating, total, faults = Counter[str](), Counter[str](), list[str]()
    with ProcessPoolExecutor() as processes:
        outcomes = processes.map(partial(_outcome, steps), seeds, chunksize=3)
        for at, (seed, (counts, found)) in enumerate(zip(seeds, outcomes, strict=True), 1):
            scene = HubScene.of(seed)
            faults += [f"hub, seed {seed}, {fault}" for fault in found]
            if at % _PROGRESS == 0:
                sys.stderr.write(f"{at:,} histories, {len(faults)} faults\n")
            if scene.board.twice:
                repeating.update(counts)
                continue
            total.update(counts)
            by_programs[scene.programs].update(counts)
            by_line[scene.line.name].update(counts)
    rows = [(f"programs: {count}", *_cells(counts)) for count, counts in sorted(by_programs.items())]
    rows += [(name, *_cells(counts)) for name, counts in by_line.items()]
    rows.append(("board: responds twice 0.1 %, slow 1 %", *_cells(repeating)))
    quote = table(
        f"{len(seeds):,} histories of {steps:,} requests through a hub, seeds {seeds[0]} to {seeds[-1]}",
        ("programs, line", *_COLUMNS),
        rows,
        notes=[
            "a quarter of the programs each: frames; the library as on a board; as over `share://`; within the hub",
            "half of them are killed in the end",
            "`refused`: movements of programs without the lease",
            "`no response`: as from a board that does not respond, because it did not, or because the cable was pulled",
            "`wrong`: responses to another request, or of another program; `stale`: older than the request",
            "programs and lines leave out the board that responds twice",
        ],
    )
    figures = {
        "histories": len(seeds),
        "faults": len(faults),
        "total": dict(total),
        "programs": {str(count): dict(counts) for count, counts in sorted(by_programs.items())},
        "must not be": {name: total[name] for name in _MUST_NOT_BE},
    }
    return {"tables": [quote], "wrong": faults[:20], "figures": figures}


def _outcome(steps: int, seed: int) -> tuple[Counter[str], list[str]]:
    history = relive_sharing(seed, steps)
    return history.counts, history.faults


def _cells(counts: Counter[str]) -> list[str]:
    return [f"{sum(counts[name] for name in names):,}" for names in _COLUMNS.values()]
