"""docs/benchmarks.md and its charts, made from the figures in benchmarks/figures/ and from nothing else."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

from benchmarks import BENCHMARKS
from benchmarks.charts import Chart, charts
from benchmarks.goals import Goal
from benchmarks.measuring import Result, Table, right_aligned

ROOT = Path(__file__).parents[1]
FIGURES = ROOT / "benchmarks/figures"
PAGE = ROOT / "docs/benchmarks.md"
PICTURES = ROOT / "docs/pictures/benchmarks"

_INTRODUCTION = """\
# Benchmarks

Everyone can produce these figures again: `pip install -e ".[bench]"` in a copy of the repository, then the command
below each heading. `python -m benchmarks --publish` measures everything and makes this page. `--report` makes it again
from the figures in `benchmarks/figures/`. [Known limits](limits.md) has the figures of the searches for faults.

Times are CPU times of one process that stays on one core, unless stated otherwise. What is compared runs in turns,
round by round, because the speed of a machine drifts. A figure is the median of the rounds, a ratio the median of the
ratios of single rounds, and the spread half the range of those, as a share of the ratio. Ratios can be compared between
machines, times only within one table.
"""


def write() -> None:
    """Write the page and its charts. Raise ImportError without matplotlib, which the extra `docs` installs."""
    from benchmarks import plots

    PAGE.write_text(page(FIGURES), encoding="utf-8")
    plots.write(PICTURES, all_charts(FIGURES))


def page(figures: Path) -> str:
    """Return the page for the JSON files in `figures`, each the `--output` of a run; Markdown."""
    results = list(_results(figures))
    sections = [_summary(results), *(_section(*result) for result in results)]
    return "\n".join([_INTRODUCTION, *("\n".join(lines) for lines in sections)])


def all_charts(figures: Path) -> list[Chart]:
    """Return the charts of the page, from top to bottom."""
    return [chart for name, result, _ in _results(figures) for chart in charts(name, result)]


def _results(figures: Path) -> Iterator[tuple[str, Result, Result]]:
    """Yield name, result and machine of each benchmark, in the order of the page."""
    runs = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(figures.glob("*.json"))]
    for name in BENCHMARKS:
        yield from ((name, run[name], run["machine"]) for run in runs if name in run)


def _section(name: str, result: Result, machine: Result) -> Iterator[str]:
    yield f"## {BENCHMARKS[name].heading}\n"
    place = "{python}, {processor}, {cores} cores, {system}; {date}".format(**machine)
    others = ", ".join(f"{other} {version}" for other, version in result.get("versions", {}).items())
    yield f"`python -m benchmarks {name}`: {place}{'; with ' * bool(others)}{others}.\n"
    yield from (f"![{chart.title}](pictures/benchmarks/{chart.name}.svg)\n" for chart in charts(name, result))
    yield from _outcome(result)
    for quote in result.get("tables", []):
        yield from _table(quote)


def _outcome(result: Result) -> Iterator[str]:
    """Yield every fault."""
    if wrong := result.get("wrong", []):
        yield from ("Wrong:\n", *(f"* {fault}" for fault in wrong), "")


def _summary(results: list[tuple[str, Result, Result]]) -> Iterator[str]:
    """Yield all goals of the page with their figures, and how many are met."""
    goals: list[tuple[str, Goal]] = [(name, goal) for name, result, _ in results for goal in result.get("goals", [])]
    rows = [
        [_link(name), goal["name"], goal["goal"], goal["figure"], "met" if goal["met"] else "**missed**"]
        for name, goal in goals
    ]
    rows += [
        [_link(name), fault, "none", "", "**wrong**"]
        for name, result, _ in results
        for fault in result.get("wrong", [])
    ]
    yield "## Goals\n"
    yield f"{sum(goal['met'] for _, goal in goals)} of {len(goals)} goals are met.\n"
    yield from _grid(["benchmark", "what", "goal", "measured", ""], rows, right=[False, False, True, True, False])
    yield ""


def _link(name: str) -> str:
    """Return a link to the section of a benchmark."""
    return f"[{name}](#{re.sub(r'[^a-z0-9 -]', '', BENCHMARKS[name].heading.lower()).replace(' ', '-')})"


def _table(quote: Table) -> Iterator[str]:
    yield f"{quote['title']}:\n"
    yield from _grid(quote["columns"], quote["rows"], right_aligned(quote))
    yield ""
    if quote["notes"]:
        yield from (f"* {note}" for note in quote["notes"])
        yield ""


def _grid(columns: list[str], rows: list[list[str]], right: list[bool]) -> Iterator[str]:
    yield _row(columns)
    yield _row(["---:" if each else "---" for each in right])
    yield from map(_row, rows)


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
