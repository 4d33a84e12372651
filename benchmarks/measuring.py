"""Fair comparisons: one core, CPU time of this process, both sides in turns, medians over rounds."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median
from time import process_time_ns
from typing import Any

Result = dict[str, Any]
"""What a benchmark found, ready for JSON; `wrong` and `slow` list the goals it missed."""


@dataclass(frozen=True)
class Comparison:
    """Medians of two sides that did the same work, in nanoseconds, and how many times faster the first was."""

    ours: float
    theirs: float
    ratio: float
    spread: float
    """Half the range of the ratios of single rounds, as a share of `ratio`."""


def pin() -> int | None:
    """Stay on one core, where the system can; return its number."""
    if not hasattr(os, "sched_setaffinity"):
        return None
    core = max(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {core})
    return core


def machine() -> Result:
    """Return what the figures were measured on."""
    return {"python": platform.python_version(), "system": platform.platform(), "core": pin()}


def timed(work: Callable[[], object]) -> int:
    """Return the CPU nanoseconds that `work` takes."""
    began = process_time_ns()
    work()
    return process_time_ns() - began


def compare(ours: Callable[[], object], theirs: Callable[[], object], rounds: int) -> Comparison:
    """Run both in turns, first once unmeasured, and compare them round by round."""
    ours()
    theirs()
    pairs: list[tuple[int, int]] = []
    for at in range(rounds):
        if at % 2:
            second = timed(theirs)
            pairs.append((timed(ours), second))
        else:
            pairs.append((timed(ours), timed(theirs)))
    ratios = [theirs_ns / max(ours_ns, 1) for ours_ns, theirs_ns in pairs]
    middle = median(ratios)
    return Comparison(
        median(pair[0] for pair in pairs),
        median(pair[1] for pair in pairs),
        middle,
        (max(ratios) - min(ratios)) / 2 / middle,
    )


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print `rows` under `columns`, right-aligned."""
    cells = [[str(cell) for cell in row] for row in (columns, *rows)]
    widths = [max(len(row[at]) for row in cells) for at in range(len(columns))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]
    sys.stdout.write("\n".join(["", title, lines[0], "-" * len(lines[0]), *lines[1:], ""]))
    sys.stdout.flush()
