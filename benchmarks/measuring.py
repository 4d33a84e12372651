"""Fair comparisons: one core, CPU time of this process, both sides in turns, medians over rounds."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from time import process_time_ns
from typing import Any, TypedDict

Result = dict[str, Any]
"""The outcome of a benchmark, ready for JSON: `wrong` lists faults as sentences, `goals` the goals with their figures;
`tables` are for the page of figures, and so are `versions`, of other software that took part, by name. Anything else
may be in it.
"""

CORES: tuple[int, ...] = tuple(sorted(os.sched_getaffinity(0))) if hasattr(os, "sched_getaffinity") else ()
"""The cores that this process had before `pin`."""


class Table(TypedDict):
    """A table as it is printed and published."""

    title: str
    columns: list[str]
    rows: list[list[str]]
    notes: list[str]


@dataclass(frozen=True)
class Comparison:
    """Medians of two sides that did the same work, in nanoseconds, and how many times faster the first was."""

    ours: float
    theirs: float
    ratio: float
    spread: float
    """Half the range of the ratios of single rounds, as a share of `ratio`."""

    @classmethod
    def of(cls, ours: Sequence[float], theirs: Sequence[float]) -> Comparison:
        """Compare the times of each round."""
        ratios = [theirs_ns / ours_ns for ours_ns, theirs_ns in zip(ours, theirs, strict=True)]
        middle = median(ratios)
        return cls(median(ours), median(theirs), middle, (max(ratios) - min(ratios)) / 2 / middle)


def pin() -> int | None:
    """Stay on one core, where the system can; return its number."""
    if not CORES:
        return None
    os.sched_setaffinity(0, {CORES[-1]})
    return CORES[-1]


def machine() -> Result:
    """Return what the figures were measured on, and when."""
    return {
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {'.'.join(platform.release().split('.')[:2])}",
        "date": datetime.now(UTC).date().isoformat(),
    }


def _processor() -> str:
    if sys.platform == "linux":
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def timed(work: Callable[[], object]) -> int:
    """Return the CPU nanoseconds that `work` takes."""
    began = process_time_ns()
    work()
    return process_time_ns() - began


def percentile(values: Sequence[float], percent: float) -> float:
    """Return the value that `percent` of the values are below."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(len(ordered) * percent / 100))]


def in_turns(sides: Sequence[Callable[[], Callable[[], object]]], rounds: int) -> list[list[int]]:
    """Return the CPU nanoseconds of each side in each round; a side makes its work anew, unmeasured, each time."""
    for side in sides:
        side()()
    times: list[list[int]] = [[] for _ in sides]
    for turn in range(rounds):
        for place in range(len(sides)):
            at = (turn + place) % len(sides)
            times[at].append(timed(sides[at]()))
    return times


def compare(ours: Callable[[], object], theirs: Callable[[], object], rounds: int) -> Comparison:
    """Run both in turns, first once unmeasured, and compare them round by round."""
    return Comparison.of(*in_turns([lambda: ours, lambda: theirs], rounds))


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]], notes: Sequence[str] = ()) -> Table:
    """Print `rows` under `columns`, and `notes` under them; return it for `Result["tables"]`."""
    quote = Table(
        title=title, columns=list(columns), rows=[[str(cell) for cell in row] for row in rows], notes=list(notes)
    )
    right = right_aligned(quote)
    cells = [quote["columns"], *quote["rows"]]
    widths = [max(len(row[at]) for row in cells) for at in range(len(columns))]
    lines = [
        "  ".join(
            cell.rjust(to) if numeric else cell.ljust(to) for cell, to, numeric in zip(row, widths, right, strict=True)
        )
        for row in cells
    ]
    rule = "-" * max(map(len, lines))
    sys.stdout.write("\n".join(["", title, lines[0], rule, *lines[1:], *quote["notes"], ""]))
    sys.stdout.flush()
    return quote


def right_aligned(quote: Table) -> list[bool]:
    """Tell for each column whether it holds numbers."""
    return [
        all(row[at].lstrip("<=-+ ")[:1].isdigit() for row in quote["rows"] if row[at] not in {"", "-"})
        for at in range(len(quote["columns"]))
    ]


def installed(package: str, versions: dict[str, str]) -> bool:
    """Note the version of `package`; False if it is not installed."""
    try:
        versions[package] = version(package)
    except PackageNotFoundError:
        return False
    return True
