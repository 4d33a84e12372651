"""Many boards in one program, and one board with a large library."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median
from typing import Any

from benchmarks.goals import at_most
from benchmarks.measuring import CORES, Result, Table, table
from benchmarks.neighbours import Neighbours
from benchmarks.scale_worker import ACTIONS

COUNTS = (1, 4, 16, 64)
KINDS = ("nothing", "virtual://", "tcp://")
"""What is asked: nothing at all, which shows how late the event loop itself is; boards in the same process, which
have to be moved and to answer; and boards in another process on another core."""
GROWTH = 1.25
"""How many times the CPU of one more board up to 16 boards each further one may take; the timers count as well."""
_WORKER = (sys.executable, "-m", "benchmarks.scale_worker")


def run(*, short: bool) -> Result:
    """Measure all counts of each kind, in turns."""
    neighbours = Neighbours()
    rounds, seconds = (1, 1) if short else (3, 2)
    found: dict[tuple[str, int], list[dict[str, Any]]] = {(kind, count): [] for kind in KINDS for count in COUNTS}
    for _ in range(rounds):
        for (kind, count), runs in found.items():
            with _boards(kind, count) as urls:
                runs.append(_json("poll", str(seconds), *urls))
    others = neighbours.note()
    with _served("serve-library") as url:
        library = [_json("library", url) for _ in range(1 if short else 3)]
    wrong = [f"{kind} {count}: not all answered" for (kind, count), runs in found.items() if _share(runs) == 0]
    goals = [
        at_most(f"CPU of one more board among {COUNTS[-1]} over one more among {COUNTS[-2]}, {kind}", ratio, GROWTH)
        for kind in KINDS[1:]
        if (ratio := _growth(found, kind)) is not None
    ]
    tables = [_polling(found, others), _library(library)]
    for one in (run for runs in found.values() for run in runs):
        one["late"] = {f"p{percent}": _late([one], percent) for percent in (50, 90, 99, 100)}
    return {
        "tables": tables,
        "wrong": wrong,
        "goals": goals,
        "polling": [{"kind": kind, "boards": count, "runs": runs} for (kind, count), runs in found.items()],
        "library": library,
    }


def _growth(found: dict[tuple[str, int], list[dict[str, Any]]], kind: str) -> float | None:
    """Return the CPU of each board added last over that of those before; None if one count costs no more."""
    one, few, many = (_middle(found[kind, count], "cpu") for count in (COUNTS[0], COUNTS[-2], COUNTS[-1]))
    before = (few - one) / (COUNTS[-2] - COUNTS[0])
    return (many - few) / (COUNTS[-1] - COUNTS[-2]) / before if before > 0 else None


@contextmanager
def _boards(kind: str, count: int) -> Iterator[list[str]]:
    """Give the addresses of boards that are there."""
    if kind == "tcp://":
        with _served("serve", str(count)) as urls:
            yield urls
    else:
        yield [kind] * count


@contextmanager
def _served(*what: str) -> Iterator[Any]:
    """Let a process on the first core serve boards; give what it says of them."""
    serving = subprocess.Popen([*_WORKER, *what], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)  # noqa: S603 - ours
    with serving:
        if CORES:
            os.sched_setaffinity(serving.pid, {CORES[0]})
        assert serving.stdout is not None  # noqa: S101 - it is a pipe
        yield json.loads(serving.stdout.readline())


def _json(*what: str) -> dict[str, Any]:
    done = subprocess.run([*_WORKER, *what], stdout=subprocess.PIPE, check=True)  # noqa: S603 - ours
    return dict(json.loads(done.stdout))


def _middle(runs: list[dict[str, Any]], name: str) -> float:
    return float(median(run[name] for run in runs))


def _share(runs: list[dict[str, Any]]) -> float:
    return _middle(runs, "share")


def _late(runs: list[dict[str, Any]], percent: int) -> float:
    """Return the median of the runs' percentiles, microseconds."""
    return float(median(run["late"][min(len(run["late"]) - 1, len(run["late"]) * percent // 100)] for run in runs))


def _polling(found: dict[tuple[str, int], list[dict[str, Any]]], others: str) -> Table:
    rows = []
    for (kind, count), runs in found.items():
        cpu = _middle(runs, "cpu")
        asks = kind != "nothing"
        rows.append(
            (
                kind,
                count,
                f"{cpu:.1%}",
                f"{cpu / count:.2%}",
                f"{_middle(runs, 'memory') / count / 1024:.0f}" if asks else "-",
                f"{_middle(runs, 'grown') / count / 1024:.0f}" if asks else "-",
                *(f"{_late(runs, percent) / 1000:.1f}" for percent in (50, 99)),
                f"{_share(runs):.1%}",
            )
        )
    return table(
        "state of 16 servos of each board, 50 times a second",
        (
            "boards",
            "count",
            "CPU of a core",
            "CPU per board",
            "KB per board",
            "KB more at the end",
            "late p50, ms",
            "late p99, ms",
            "answered",
        ),
        rows,
        [
            "Late: from when a request is due until the program has the servos. Nothing: the timers of asyncio alone.",
            "virtual://: boards in the same process, whose CPU and memory count; tcp://: in another on another core.",
            "More at the end: what polling needs, and the times of the latest 4,096 round trips (up to 128 KB).",
            others,
        ],
    )


def _library(runs: list[dict[str, Any]]) -> Table:
    return table(
        f"a board with {ACTIONS:,} actions of 16 servos, over TCP",
        ("what", "requests", "ms", "CPU, ms", "KB kept", "KB at most"),
        [
            (
                name,
                runs[0][name]["requests"],
                *(f"{median(run[name][key] for run in runs) * 1000:.0f}" for key in ("seconds", "cpu")),
                *(f"{median(run[name][key] for run in runs) / 1024:.0f}" for key in ("kept", "peak")),
            )
            for name in runs[0]
        ],
        ["Kept is the memory of what is returned, as Python counts it; at most while it is being read."],
    )
