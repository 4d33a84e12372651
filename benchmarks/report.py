"""docs/benchmarks.md and its charts, made from the figures in benchmarks/figures/ and from nothing else."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from benchmarks import BENCHMARKS
from benchmarks.charts import Chart, charts
from benchmarks.measuring import Result, Table, right_aligned

ROOT = Path(__file__).parents[1]
FIGURES = ROOT / "benchmarks/figures"
PAGE = ROOT / "docs/benchmarks.md"
PICTURES = ROOT / "docs/pictures/benchmarks"

_INTRODUCTION = """\
# Benchmarks

Everyone can produce these figures again: `pip install -e ".[bench]"` in a copy of the repository, then the command
above each table. `python -m benchmarks --report` makes this page and its charts from the figures in
`benchmarks/figures/`.

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
    sections = [_section(name, result, machine) for name, result, machine in _results(figures)]
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
    yield f"## {BENCHMARKS[name][2]}\n"
    yield f"```console no-run\n$ python -m benchmarks {name}\n```\n"
    yield "{python}, {processor}, {cores} cores, {system}; {date}.".format(**machine)
    if versions := result.get("versions"):
        yield f"With {', '.join(f'{other} {version}' for other, version in versions.items())}."
    yield ""
    yield from (f"![{chart.title}](pictures/benchmarks/{chart.name}.svg)\n" for chart in charts(name, result))
    for quote in result.get("tables", []):
        yield from _table(quote)
    missed = [*result.get("wrong", []), *result.get("slow", [])]
    if missed:
        yield from ("Goals missed:\n", *(f"* {fault}" for fault in missed), "")
    elif "wrong" in result or "slow" in result:
        yield "All goals are met.\n"


def _table(quote: Table) -> Iterator[str]:
    yield f"{quote['title']}:\n"
    yield _row(quote["columns"])
    yield _row(["---:" if right else "---" for right in right_aligned(quote)])
    yield from map(_row, quote["rows"])
    yield ""
    if quote["notes"]:
        yield from (f"* {note}" for note in quote["notes"])
        yield ""


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
