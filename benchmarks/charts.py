"""Which columns of which tables are shown as charts too."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

from benchmarks.measuring import Result, Table


@dataclass(frozen=True)
class Chart:
    """Bars, or lines where `is_line`: one value of each series for each label."""

    name: str
    """The name of its file, without `.svg`."""
    title: str
    axis: str
    labels: Sequence[str]
    series: dict[str, list[str]]
    """Name to cells, as they stand in the table; "-" for no value."""
    is_log: bool = False
    is_line: bool = False
    goal: float | None = None
    """Where a line is drawn across the chart."""


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
    speeds = _table(tables, "Frames of about 14 bytes")
    yield Chart(
        "parser-speed",
        "Frames parsed per second, 14 bytes each",
        "frames/s, in chunks of 4 KiB; longer is better",
        _column(speeds, "parser"),
        {"frames/s": _column(speeds, "frames/s")},
        is_log=True,
    )
    found = _table(tables, "Intact frames found")
    found["rows"] = [row for row in found["rows"] if row[1] in _SHORT_FRAMES]
    yield Chart(
        "parser-recall",
        "Intact frames found in a damaged stream",
        "% of the intact frames; noise between frames and 1 % of all bytes replaced",
        _column(found, "parser"),
        {"found": _column(found, "both")},
    )


_SHORT_FRAMES = {"13", "14", "21"}


def _roundtrip(tables: list[Table]) -> Iterator[Chart]:
    short = _table(tables, "request and response of 14 bytes")
    yield Chart(
        "round-trip",
        "What a client adds to a round trip of 14 bytes",
        "µs more than os.write, epoll and os.read; shorter is better",
        _column(short, "client")[2:],
        {"over epoll": _column(short, "over epoll")[2:]},
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


def _wire(tables: list[Table]) -> Iterator[Chart]:
    shares = _table(tables, "Share of the line that the states")
    depths = [name for name in shares["columns"] if name.startswith("depth ")]
    yield Chart(
        "wire",
        "The share of a line that is used",
        "% of the line that the states of 16 servos take, by requests on the line at once",
        depths,
        {
            row[0].partition(", ")[0]: [row[shares["columns"].index(depth)] for depth in depths]
            for row in shares["rows"]
            if row[1] == "servolink"
        },
        is_line=True,
        goal=100,
    )


def _pipelined(tables: list[Table]) -> Iterator[Chart]:
    rates = _table(tables, "responses of 186 bytes")
    cells = {(row[0], row[1]): row[2] for row in rates["rows"]}
    clients = list(dict.fromkeys(client for client, _ in cells))
    yield Chart(
        "pipelined",
        "Requests per second over a pseudo-terminal",
        "requests/s, by requests on the line at once; longer is better",
        clients,
        {f"depth {depth}": [cells[client, depth] for client in clients] for depth in ("1", "4", "16")},
    )


_CHARTS: dict[str, Callable[[list[Table]], Iterator[Chart]]] = {
    "wire": _wire,
    "roundtrip": _roundtrip,
    "pipelined": _pipelined,
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
