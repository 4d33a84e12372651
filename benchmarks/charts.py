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
    mixed = _table(tables, "How many times faster ours is on streams of many kinds")
    sizes = ["64", "one frame", "4096"]
    yield Chart(
        "parser-mixed",
        "How many times as fast as other parsers, on a stream of mixed frames",
        "times as fast by bytes in a chunk, 14 and 186 bytes in turns; servolink is faster above the line",
        sizes,
        {row[0]: _alike(mixed, row, sizes) for row in mixed["rows"] if row[1] == "both in turns" and row[0] in _LINES},
        is_log=True,
        is_line=True,
        goal=1,
    )


def _alike(mixed: Table, row: list[str], sizes: list[str]) -> list[str]:
    """Return the cells of a row: with objects where the other parser makes some too."""
    typed = [row[mixed["columns"].index(f"typed, {size}")] for size in sizes]
    return typed if "-" not in typed else [row[mixed["columns"].index(size)] for size in sizes]


_SHORT_FRAMES = {"13", "14", "21", "32"}
_LINES = {"textbook parser", "aioesphomeapi", "cobs", "pymodbus, socket", "pymavlink", "zigpy-znp"}


def _hostile(tables: list[Table]) -> Iterator[Chart]:
    streams = _table(tables, "Hostile streams")
    yield Chart(
        "hostile",
        "Cost of streams made to be expensive",
        "ns per byte, for two lengths; the limit is 1,000",
        _column(streams, "stream"),
        {name: _column(streams, name) for name in ("128 KB", "512 KB")},
        goal=1000,
    )


def _reliability(tables: list[Table]) -> Iterator[Chart]:
    stalls = _table(tables, "responses that arrived before")
    yield Chart(
        "stalls",
        "Responses lost because the event loop was busy when they arrived",
        "% of the responses that arrived before their deadline",
        [f"Python {row[0].rpartition('.')[0]}, {row[1].partition(',')[0]}" for row in stalls["rows"]],
        {name: _column(stalls, name) for name in ("asyncio.wait_for", "asyncio.timeout", "servolink")},
    )


def _roundtrip(tables: list[Table]) -> Iterator[Chart]:
    short = _table(tables, "request and response of 14 bytes")
    rows = {(row[0], row[1]): row for row in short["rows"]}
    clients = list(dict.fromkeys(name for name, loop in rows if loop))
    over = short["columns"].index("over epoll")
    yield Chart(
        "round-trip",
        "What a client adds to a round trip of 14 bytes",
        "µs more than os.write, epoll and os.read; shorter is better",
        clients,
        {loop: [rows[client, loop][over] for client in clients] for loop in ("asyncio", "uvloop")},
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


def _scale(tables: list[Table]) -> Iterator[Chart]:
    polled = _table(tables, "state of 16 servos")
    counts = list(dict.fromkeys(_column(polled, "count")))
    cpu = polled["columns"].index("CPU of a core")
    yield Chart(
        "scale",
        "Many boards in one program, each asked 50 times a second",
        "% of a core, by number of boards; nothing: the timers alone",
        counts,
        {kind: [row[cpu] for row in polled["rows"] if row[0] == kind] for kind in ("nothing", "virtual://", "tcp://")},
        is_line=True,
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


def _crowd(tables: list[Table]) -> Iterator[Chart]:
    costs = _table(tables, "Callers at once")
    counts = costs["columns"][2:-1]
    yield Chart(
        "crowd",
        "What a request costs where many wait",
        "µs of CPU of each request, by number of callers; one query",
        counts,
        {
            f"depth {row[1]}" if row[0] == "one query" else "asyncio alone": row[2:-1]
            for row in costs["rows"]
            if row[0] == "one query" or (row[0], row[1]) == ("asyncio alone", "1")
        },
        is_log=True,
        is_line=True,
    )


def _pipelined(tables: list[Table]) -> Iterator[Chart]:
    rates = _table(tables, "responses of 186 bytes")
    cells = {(f"{row[0]}, {row[1]}".rstrip(", "), row[2]): row[3] for row in rates["rows"]}
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
    "crowd": _crowd,
    "start": _start,
    "scale": _scale,
    "peers": _peers,
    "hostile": _hostile,
    "reliability": _reliability,
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
