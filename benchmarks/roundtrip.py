"""A request and its answer over a pseudo-terminal: beside bare system calls and other libraries."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from statistics import median
from time import process_time_ns

from benchmarks.goals import Goal, at_least, at_most
from benchmarks.measuring import CORES, Result, Table, installed, table
from benchmarks.neighbours import Neighbours
from benchmarks.responder import Responder, language
from benchmarks.roundtrip_clients import LOOPS, PEERS, RAW, Client, Modbus, Ours, OurSync, Polling

SIZES = (14, 186)
TIMES = 2.0
"""How many times the median of epoll a request may take."""
PEER_GOAL = 2.0
"""How many times as long pymodbus takes."""
SYNC_GOAL = 2.5
"""How many times as long `servolink.sync` may take."""


@dataclass
class _Case:
    client: Client
    p50: list[float] = field(default_factory=list)  # one per round, nanoseconds
    p99: list[float] = field(default_factory=list)
    wall: list[float] = field(default_factory=list)  # per request, nanoseconds
    cpu: list[float] = field(default_factory=list)

    def measure(self, times: int) -> None:
        gc.collect()
        cpu = process_time_ns()
        took = sorted(self.client.ask(times))
        self.cpu.append((process_time_ns() - cpu) / times)
        self.wall.append(sum(took) / times)
        self.p50.append(took[times // 2])
        self.p99.append(took[times * 99 // 100])


def run(*, short: bool) -> Result:
    """Measure all clients in turns, for each size of answer."""
    rounds, times = (1, 50) if short else (21, 400)
    result: Result = {"tables": [], "goals": [], "versions": {}, "cases": []}
    measured: dict[int, list[_Case]] = {}
    neighbours = Neighbours()
    for size in SIZES:
        cases = measured[size] = list(_cases(size, result["versions"]))
        with ExitStack() as stack:
            for case in cases:
                responder = Responder(case.client.answers)
                stack.callback(responder.close)
                case.client.open(responder.path)
                stack.callback(case.client.close)
            _measure(cases, rounds, times)
        result["cases"] += [
            {"answer": size, "client": case.client.name}
            | {name: [round(value) for value in getattr(case, name)] for name in ("p50", "p99", "wall", "cpu")}
            for case in cases
        ]
    result["tables"].append(_table(measured, neighbours.note()))
    result["goals"] += _goals(SIZES[0], measured[SIZES[0]])
    return result


def _measure(cases: list[_Case], rounds: int, times: int) -> None:
    for case in cases:
        case.client.ask(times)  # not counted
    for at in range(rounds):
        for case in cases if at % 2 else reversed(cases):
            case.measure(times)


def _cases(size: int, versions: dict[str, str]) -> Iterator[_Case]:
    for kind in (*RAW, OurSync, *LOOPS, *PEERS):
        if not kind.package or installed(kind.package, versions):
            yield _Case(kind(size))


def _ratio(case: _Case, to: _Case) -> float:
    return median(one / other for one, other in zip(case.p50, to.p50, strict=True))


def _over(case: _Case, to: _Case) -> float:
    """Return how much longer a request takes, in nanoseconds."""
    return median(one - other for one, other in zip(case.p50, to.p50, strict=True))


def _only(cases: list[_Case], kind: type[Client]) -> _Case | None:
    return next((case for case in cases if type(case.client) is kind), None)


def _goals(size: int, cases: list[_Case]) -> Iterator[Goal]:
    epoll, ours, modbus, sync = (_only(cases, kind) for kind in (Polling, Ours, Modbus, OurSync))
    assert epoll is not None  # noqa: S101 - it is always measured, as the next two are
    assert ours is not None  # noqa: S101
    assert sync is not None  # noqa: S101
    yield at_most(f"time of `request` over that of epoll, {size} bytes", _ratio(ours, epoll), TIMES)
    if modbus is not None:
        system = _over(modbus, epoll) / _over(ours, epoll)
        name = f"time of pymodbus over that of `request`, {size} bytes (without that of epoll: {system:.1f}x)"
        yield at_least(name, _ratio(modbus, ours), PEER_GOAL)
    name = f"time of `request` of servolink.sync over that of `request`, {size} bytes"
    yield at_most(name, _ratio(sync, ours), SYNC_GOAL)


def _table(measured: dict[int, list[_Case]], others: str) -> Table:
    columns = [f"{size} bytes: {what}" for size in measured for what in ("p50", "p50 / epoll", "p99", "CPU")]
    return table(
        "A request and its response over a pseudo-terminal, µs",
        ("client", *columns),
        [
            (
                cases[0].client.name,
                *(cell for size, case in zip(measured, cases, strict=True) for cell in _row(case, measured[size])),
            )
            for cases in zip(*measured.values(), strict=True)
        ],
        [
            f"The other end is a program in {language()}, " + _where() + ".",
            "Times are wall-clock times, except CPU, which is the client's own.",
            f"{others} The longer the system itself takes, the smaller are all ratios.",
        ],
    )


def _row(case: _Case, cases: list[_Case]) -> Iterator[str]:
    epoll = _only(cases, Polling)
    assert epoll is not None  # noqa: S101 - it is one of RAW
    yield f"{median(case.p50) / 1000:.1f}"
    yield f"{_ratio(case, epoll):.2f}x"
    yield from (f"{median(values) / 1000:.1f}" for values in (case.p99, case.cpu))


def _where() -> str:
    return "on another core than the clients" if len(CORES) > 1 else "wherever the system puts it"
