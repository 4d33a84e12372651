"""Thousands of boards at one broker: the shares of controller, bridges and broker in a stop, and at rest.

Ten boards are whole: virtual boards with hubs in one process, `servolink fleet join` in another. The others are
stand-ins, which cost little. So a machine with two cores shows the needs of the controller, and of a machine with
boards, in a fleet of that size. Each process is measured by itself.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from statistics import median
from time import perf_counter, sleep
from typing import Any

from benchmarks.fleet_processes import Process, broker_process, pipes, started, until_ready
from benchmarks.goals import Goal, at_most
from benchmarks.measuring import CORES, Result, Table, percentile, table

COUNTS = (200, 2000)
STOPPED = (150.0, 300.0)  # milliseconds, 99 times in 100, with fewest boards and with most
GROWTH = 1.25  # CPU of a stop for each board, with most boards over fewest
_WORKER = "benchmarks.thousands_worker"
_WHOLE = [f"rex{number}" for number in range(10)]
_QUEUE = ("max_queued_messages 20000", "max_inflight_messages 200")
"""A stop of thousands is answered by thousands: mosquitto drops those beyond 1,000 unless told otherwise."""


@dataclass
class Place:
    """What the controller of each size finds there."""

    url: str
    broker: Process
    hubs: subprocess.Popen[str]
    bridge: Process


@dataclass
class Case:
    """What was measured with so many boards."""

    boards: int
    found: dict[str, Any]
    """What the controller has measured."""
    at_rest: dict[str, float]
    """CPU by process, as a share of a core."""
    of_stop: dict[str, float]
    """CPU by process, in seconds for each stop of all boards."""
    written: list[float]
    """Seconds from each stop until the last of the whole boards was sent it."""


def run(*, short: bool) -> Result:
    """Measure each number of boards."""
    if CORES:
        os.sched_setaffinity(0, CORES)
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    counts = (20, 60) if short else COUNTS
    with _place() as place:
        cases = [_measure(place, count, *((1.0, 3) if short else (15.0, 60))) for count in counts]
    wrong = [
        f"{case.boards} boards: the controller knows {case.found['known']}"
        for case in cases
        if case.found["known"] != case.boards
    ]
    return {
        "tables": [_stop_table(cases)],
        "goals": [*_goals(cases)],
        "wrong": wrong,
        "cases": [asdict(case) for case in cases],
    }


@contextmanager
def _place() -> Iterator[Place]:
    """Yield a broker with ten whole boards."""
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="servolink-fleet-"))
        url, broker = stack.enter_context(broker_process(*_QUEUE))
        hubs = stack.enter_context(started(_WORKER, "hubs", *_WHOLE, folder=folder))
        until_ready(hubs)
        bridge = stack.enter_context(_joined(folder, url))
        sleep(2.0)
        yield Place(url, Process(broker), hubs, bridge)


@contextmanager
def _joined(folder: str, url: str) -> Iterator[Process]:
    """Run `servolink fleet join`."""
    with started("servolink", "fleet", "join", url, *_WHOLE, folder=folder) as process:
        for _ in _WHOLE:
            if not pipes(process)[1].readline().startswith("joined"):
                raise SystemExit("servolink fleet join has ended")
        try:
            yield Process(process.pid)
        finally:
            process.terminate()


def _measure(place: Place, count: int, seconds: float, rounds: int) -> Case:
    """Have a crowd join, and a controller look on for `seconds` and stop all `rounds` times."""
    of = {"bridge": place.bridge, "broker": place.broker, "hubs": Process(place.hubs.pid)}
    with started(_WORKER, "crowd", place.url, str(count - len(_WHOLE))) as crowd:
        until_ready(crowd)
        given = ("controller", place.url, str(seconds), str(rounds), str(count))
        with started(_WORKER, *given) as controller:
            _told(controller)
            rest = _Moment(of)
            _told(controller)
            _written(place.hubs)
            stops = _Moment(of)
            found = _told(controller)
            over = _Moment(of)
    written = _written(place.hubs)
    at_rest = {name: (stops.cpu[name] - rest.cpu[name]) / (stops.at - rest.at) for name in of}
    of_stop = {name: (over.cpu[name] - stops.cpu[name] - at_rest[name] * (over.at - stops.at)) / rounds for name in of}
    at_rest["controller"], of_stop["controller"] = found["cpu_at_rest"], median(found["cpu_of_stops"])
    first = [max(min(t for t in times if t >= asked) - asked for times in written.values()) for asked in found["asked"]]
    return Case(count, found, at_rest, of_stop, first)


class _Moment:
    """CPU of processes at a moment."""

    def __init__(self, of: Mapping[str, Process]) -> None:
        self.at = perf_counter()
        self.cpu = {name: one.cpu for name, one in of.items()}


def _told(controller: subprocess.Popen[str]) -> dict[str, Any]:
    """Return the next line of the controller."""
    line = pipes(controller)[1].readline()
    if not line:
        raise SystemExit("the controller of the benchmark has ended")
    found: dict[str, Any] = json.loads(line)
    return found


def _written(hubs: subprocess.Popen[str]) -> dict[str, list[float]]:
    """Return the moments at which each whole board was sent a stop since the last call."""
    stdin, stdout = pipes(hubs)
    stdin.write("\n")
    stdin.flush()
    found: dict[str, list[float]] = json.loads(stdout.readline())
    return found


# --- figures ----------------------------------------------------------------------------------------------------------


def _goals(cases: list[Case]) -> Iterator[Goal]:
    fewest, most = cases[0], cases[-1]
    for case, limit in zip((fewest, most), STOPPED, strict=True):
        where = f"with broker and stand-ins, 99 times in 100; {case.boards} boards"
        name = f"from a stop of all until a board has confirmed it, {where}"
        yield at_most(name, 1000 * case.found["confirmed"][1], limit, "{:.0f} ms")
    ratio = (most.of_stop["controller"] / most.boards) / (fewest.of_stop["controller"] / fewest.boards)
    name = f"CPU of the controller in a stop, for each of {most.boards} boards over each of {fewest.boards}"
    yield at_most(name, ratio, GROWTH)


def _ms(seconds: list[float], percent: float = 99) -> float:
    return 1000 * percentile(seconds, percent)


def _stop_table(cases: list[Case]) -> Table:
    rows = [
        (
            case.boards,
            *(f"{_ms(case.written, percent):.1f}" for percent in (50, 99)),
            *(f"{1000 * value:.0f}" for value in case.found["confirmed"]),
            *(f"{_ms(case.found['last'], percent):.0f}" for percent in (50, 99)),
            f"{1e6 * case.of_stop['controller'] / case.boards:.0f}",
            f"{1e6 * case.of_stop['broker'] / case.boards:.0f}",
            *(f"{1e6 * case.of_stop[name] / len(_WHOLE):.0f}" for name in ("bridge", "hubs")),
        )
        for case in cases
    ]
    return table(
        "A stop of all boards",
        (
            "boards",
            "sent to the board, p50, ms",
            "p99",
            "confirmed, p50, ms",
            "p99",
            "all confirmed, p50, ms",
            "p99",
            "CPU per board, µs: controller",
            "broker",
            "bridge",
            "hub",
        ),
        rows,
        [
            f"{len(cases[-1].written)} stops, as by `servolink fleet stop`. Sent: until ten whole boards were.",
            "Confirmed: until the controller has the answer of a board, and of all boards.",
            "Controller, broker, whole boards and stand-ins share two cores, and wait for each other.",
        ],
    )
