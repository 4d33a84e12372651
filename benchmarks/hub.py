"""A board shared by a hub, beside a relay of ten lines and no hub: what the hub adds, and who waits for whom."""

from __future__ import annotations

import asyncio
import gc
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import AsyncExitStack, contextmanager
from dataclasses import dataclass, field
from statistics import median
from time import perf_counter_ns

from benchmarks.answers import answers
from benchmarks.goals import Goal, at_least, at_most
from benchmarks.hub_crowd import Waits, starve
from benchmarks.measuring import CORES, Result, Table, table
from benchmarks.neighbours import Neighbours
from benchmarks.responder import Responder, language
from servolink.client.board import Board
from servolink.client.connecting import connect
from servolink.protocol.codec import Codec
from servolink.protocol.editing import QueryActionRequest, QueryActionResponse
from servolink.protocol.records import Step

PROGRAMS = (1, 32)
BOARDS = {"at once": 0.0, "after 1 ms, as over USB": 0.001}
"""When a board responds, with the seconds."""
ADDED = 0.15
"""Milliseconds that the hub may add to the median of one program, on a board that responds after 1 ms."""
SHARE = 0.9
"""Of the requests per second through a relay of ten lines, on a board that responds at once."""
WITHOUT, RELAY, _ = WAYS = ("without", "through a relay", "through the hub")
MOST_WAITED = 33
"""Exchanges that one program may wait for while 31 others flood, 99 times in 100."""
_STEPS = tuple(Step(at % 16 + 1, 90 - at, 20) for at in range(18))


@dataclass
class _Case:
    """So many programs, each of which asks one thing after the other."""

    board: str
    programs: int
    way: str
    rate: list[float] = field(default_factory=list)
    """Requests per second, of each round."""
    p50: list[float] = field(default_factory=list)
    """Milliseconds."""
    p99: list[float] = field(default_factory=list)

    async def measure(self, boards: list[Board], times: int) -> None:
        """Let each program ask; without a hub they are callers of one board."""
        took: list[int] = []
        gc.collect()
        began = perf_counter_ns()
        async with asyncio.TaskGroup() as group:
            for at in range(self.programs):
                group.create_task(_ask(boards[at % len(boards)], at + 1, max(1, times // self.programs), took))
        self.rate.append(len(took) * 1e9 / (perf_counter_ns() - began))
        took.sort()
        self.p50.append(took[len(took) // 2] / 1e6)
        self.p99.append(took[len(took) * 99 // 100] / 1e6)


async def _ask(board: Board, record_id: int, times: int, took: list[int]) -> None:
    """Ask for a record of its own: the hub joins equal queries, which would cost it nothing."""
    query = QueryActionRequest(record_id)
    for _ in range(times):
        began = perf_counter_ns()
        await board.request(query)
        took.append(perf_counter_ns() - began)


def run(*, short: bool) -> Result:
    """Measure all ways in turns, for each number of programs; then floods."""
    rounds, times = (1, 100) if short else (15, 1600)
    neighbours = Neighbours()
    cases = [case for board in BOARDS for case in asyncio.run(_measure(board, rounds, times))]
    waits = asyncio.run(starve(200 if short else 5000))
    return {
        "tables": [_table(cases, neighbours.note())],
        "goals": [*_goals(cases), *_crowd_goals(waits)],
        "cases": [
            {"board": case.board, "programs": case.programs, "way": case.way}
            | {"rate": case.rate, "p50": case.p50, "p99": case.p99}
            for case in cases
        ],
    }


async def _measure(board: str, rounds: int, times: int) -> list[_Case]:
    cases = [_Case(board, programs, way) for programs in PROGRAMS for way in WAYS]
    here = os.sched_getaffinity(0) if CORES else set[int]()
    async with AsyncExitStack() as stack:
        boards: dict[str, list[Board]] = {}
        for way in WAYS:
            responder = Responder(_answers(), BOARDS[board])
            stack.callback(responder.close)
            url = responder.path if way == WITHOUT else stack.enter_context(_served(responder.path, way))
            connections = 1 if way == WITHOUT else max(PROGRAMS)
            boards[way] = [await stack.enter_async_context(connect(url)) for _ in range(connections)]
        for case in cases:  # not counted
            await _Case(board, case.programs, case.way).measure(boards[case.way], times)
        for at in range(rounds):
            for case in cases if at % 2 else reversed(cases):
                if CORES:  # hub and relay have the core on which the program without one is
                    os.sched_setaffinity(0, here if case.way == WITHOUT else {CORES[0]})
                await case.measure(boards[case.way], times)
        if CORES:
            os.sched_setaffinity(0, here)
    return cases


@contextmanager
def _served(path: str, way: str) -> Iterator[str]:
    """Run a hub or a relay in a process of its own; yield the address of its TCP door."""
    with tempfile.TemporaryDirectory(prefix="servolink-hub-") as folder:
        command = [
            sys.executable,
            "-m",
            "benchmarks.hub_worker",
            path,
            str(CORES[-1]) if CORES else "",
            *(["relay"] if way == RELAY else []),
        ]
        process = subprocess.Popen(  # noqa: S603 - our own program
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "XDG_RUNTIME_DIR": folder, "XDG_CONFIG_HOME": folder},
        )
        assert process.stdin is not None  # noqa: S101 - it is a pipe
        assert process.stdout is not None  # noqa: S101 - it is a pipe
        try:
            yield next(url for url in json.loads(process.stdout.readline()) if url.startswith("tcp://"))
        finally:
            process.stdin.close()
            process.wait()


def _answers() -> dict[int, bytes]:
    """Return the frames of a board; every record that it is asked for has one length, and none is there."""
    return answers() | {QueryActionRequest.packet_id: Codec().encode(QueryActionResponse(0, "wave", _STEPS))}


def _triples(cases: list[_Case]) -> Iterator[tuple[_Case, _Case, _Case]]:
    """Yield each case without a hub, with a relay, and with a hub."""
    return zip(cases[::3], cases[1::3], cases[2::3], strict=True)


def _share(case: _Case, of: _Case) -> float:
    """Return the rate as a share of that of another way, round by round."""
    return median(one / other for one, other in zip(case.rate, of.rate, strict=True))


def _added(case: _Case, to: _Case) -> float:
    """Return the milliseconds that a way adds to the median of another, round by round."""
    return median(one - other for one, other in zip(case.p50, to.p50, strict=True))


def _goals(cases: list[_Case]) -> Iterator[Goal]:
    for direct, relay, hub in _triples(cases):
        where = f"board that responds {direct.board}, programs: {direct.programs}"
        if BOARDS[direct.board] and direct.programs == 1:
            yield at_most(
                f"what the hub adds to the median over TCP; {where}", _added(hub, direct), ADDED, "{:+.2f} ms"
            )
        elif not BOARDS[direct.board] and direct.programs in {PROGRAMS[0], PROGRAMS[-1]}:
            name = f"requests per second through the hub over those through a relay of ten lines; {where}"
            yield at_least(name, 100 * _share(hub, relay), 100 * SHARE, "{:.0f} %")


def _crowd_goals(waits: Waits) -> Iterator[Goal]:
    name = f"exchanges that a program waits for beside {waits.flooding} that flood, 99 times in 100"
    yield at_most(name, waits.percentile(99), MOST_WAITED, "{:.0f}")


def _table(cases: list[_Case], others: str) -> Table:
    size = len(_answers()[QueryActionRequest.packet_id])
    return table(
        f"A board with and without a hub: responses of {size} bytes, one request at a time",
        ("board responds", "programs", "", "requests/s", "of those without", "p50, ms", "p99, ms", "added to p50, ms"),
        [row for triple in _triples(cases) for row in _rows(*triple)],
        [
            f"The board is a program in {language()} at a pseudo-terminal. Each program asks for a record of its own.",
            "Without a hub the programs are tasks of one process. With it they are TCP connections of one process.",
            "The relay is ten lines of asyncio: one request after the other, and each response to its program.",
            "The hub is on the core of the programs without it, and those with it are on the core of the board.",
            f"Times are wall-clock times. {others}",
        ],
    )


def _rows(direct: _Case, *others: _Case) -> Iterator[tuple[object, ...]]:
    for case in (direct, *others):
        compared = ("", "") if case is direct else (f"{_share(case, direct):.0%}", f"{_added(case, direct):+.2f}")
        figures = f"{median(case.p50):.2f}", f"{median(case.p99):.2f}"
        yield case.board, case.programs, case.way, f"{median(case.rate):,.0f}", compared[0], *figures, compared[1]
