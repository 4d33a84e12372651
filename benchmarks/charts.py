"""Which columns of which tables are shown as charts too."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

from benchmarks.measuring import Result, Table


@dataclass(frozen=True)
class Chart:
    """Bars: one value of each series for each label."""

    name: str
    """The name of its file, without `.svg`."""
    title: str
    axis: str
    labels: Sequence[str]
    series: dict[str, list[str]]
    """Name to cells, as they stand in the table; "-" for no value."""
    is_log: bool = False


def charts(name: str, result: Result) -> list[Chart]:
    """Return the charts of a benchmark's result, as far as it has the tables that they show."""
    found: list[Chart] = []
    if name in _CHARTS and result.get("tables"):
        with suppress(LookupError):
            found.extend(_CHARTS[name](result["tables"]))
    return found


def number(cell: str) -> float | None:
    """Return the value of a cell; for "3 of 10" the share in percent, None for "-"."""
    if cell == "-":
        return None
    found = [float(text.replace(",", "")) for text in re.findall(r"-?[\d,]+(?:\.\d+)?", cell)]
    return found[0] / found[1] * 100 if " of " in cell else found[0]


def _peers(tables: list[Table]) -> Iterator[Chart]:
    speeds = _table(tables, "Frames parsed per second")
    yield Chart(
        "parser-speed",
        "Frames parsed per second, 14 bytes each",
        "frames/s, in chunks of 4 KiB; longer is better",
        _column(speeds, "parser"),
        {"frames/s": _column(speeds, "14 bytes: frames/s")},
        is_log=True,
    )


def _roundtrip(tables: list[Table]) -> Iterator[Chart]:
    times = _table(tables, "A request and its response")
    yield Chart(
        "round-trip",
        "A request of 14 bytes and its response",
        "µs, half of all requests; shorter is better",
        _column(times, "client"),
        {"p50": _column(times, "14 bytes: p50")},
    )


def _start(tables: list[Table]) -> Iterator[Chart]:
    times = _table(tables, "from the start of Python")
    yield Chart(
        "start",
        "Time until a program or a command has started",
        "ms",
        _column(times, "what"),
        {"time": _column(times, "time")},
    )


_CHARTS: dict[str, Callable[[list[Table]], Iterator[Chart]]] = {
    "roundtrip": _roundtrip,
    "start": _start,
    "peers": _peers,
}


def _table(tables: list[Table], title: str) -> Table:
    """Return a copy of the table whose title begins like this. Raise LookupError if there is none."""
    found = next((table for table in tables if table["title"].startswith(title)), None)
    if found is None:
        raise LookupError(f"no table is called {title!r}")
    return Table(title=found["title"], columns=found["columns"], rows=list(found["rows"]), notes=found["notes"])


def _column(table: Table, name: str) -> list[str]:
    at = table["columns"].index(name)
    return [row[at] for row in table["rows"]]
