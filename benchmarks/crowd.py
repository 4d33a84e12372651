"""Many callers at once: the CPU of a request by the number of callers."""

from __future__ import annotations

import asyncio
import gc
from collections.abc import Awaitable, Callable, Iterator
from time import process_time_ns
from typing import Any

from benchmarks.goals import Goal, at_most
from benchmarks.instant import InstantTransport
from benchmarks.measuring import Result, Table, table
from servolink.client.board import Board
from servolink.client.connect import connect
from servolink.protocol.editing import QueryProjectIDRequest
from servolink.protocol.packet import Query
from servolink.protocol.servos import ALL_SERVOS, QueryServoListRequest, QueryServoRequest
from servolink.protocol.settings import QueryRemainPowerRequest

WAITERS = (1, 10, 100, 1000, 10_000)
DEPTHS = (1, 4, 16)
GROWTH = 1.2
"""How many times the cost of a request may grow, from the number of callers at which it is least to any larger one."""

_LOADS: dict[str, tuple[Query[Any], ...]] = {
    "one query": (QueryServoRequest(ALL_SERVOS),),
    "four queries in turns": (
        QueryServoRequest(ALL_SERVOS),
        QueryServoListRequest(),
        QueryRemainPowerRequest(),
        QueryProjectIDRequest(),
    ),
}
_ALONE = "asyncio alone"
_HOPELESS = 4.0  # above this growth, larger numbers are not tried: a cost that grows with the callers takes minutes

Ask = Callable[[int], Awaitable[object]]
"""Make the request with this number."""
Costs = dict[tuple[str, int], dict[int, float]]
"""CPU microseconds of a request, by load and depth, by number of callers."""


def run(*, short: bool) -> Result:
    """Measure all depths and numbers of callers; the least of all rounds counts, as a busy machine only adds."""
    rounds, total = (1, 200) if short else (3, 5000)
    costs: Costs = {}
    gc.collect()
    gc.freeze()
    try:
        for _ in range(rounds):
            for waiters in WAITERS[: 3 if short else None]:
                hopeless = {case for case, us in costs.items() if growth(us)[0] > _HOPELESS and waiters > max(us)}
                for case, cost in asyncio.run(_measure(waiters, total, hopeless)):
                    of_case = costs.setdefault(case, {})
                    of_case[waiters] = min(cost, of_case.get(waiters, cost))
    finally:
        gc.unfreeze()
    return {
        "tables": [_table(costs)],
        "goals": list(_goals(costs)),
        "costs": [{"load": load, "depth": depth, "us": us} for (load, depth), us in costs.items()],
    }


async def _measure(waiters: int, total: int, hopeless: set[tuple[str, int]]) -> list[tuple[tuple[str, int], float]]:
    found = []
    for depth in DEPTHS:
        turns = asyncio.Semaphore(depth)
        found.append(((_ALONE, depth), await _cost(lambda _, turns=turns: _wait(turns), waiters, total)))  # type: ignore[misc]
        async with connect(InstantTransport(), depth=depth, patience=600) as board:
            for load, queries in _LOADS.items():
                if (load, depth) in hopeless:
                    continue
                ask = _asking(board, queries)
                await ask(0)
                found.append(((load, depth), await _cost(ask, waiters, total)))
    return found


async def _wait(turns: asyncio.Semaphore) -> None:
    async with turns:
        await asyncio.sleep(0)


def _asking(board: Board, queries: tuple[Query[Any], ...]) -> Ask:
    return lambda number: board.request(queries[number % len(queries)])


async def _cost(ask: Ask, waiters: int, total: int) -> float:
    """Return the CPU microseconds of a request where so many callers wait at once."""
    times = max(1, total // waiters)
    began = process_time_ns()
    for _ in range(times):
        await asyncio.gather(*[ask(number) for number in range(waiters)])
    return (process_time_ns() - began) / times / waiters / 1000


def growth(us: dict[int, float]) -> tuple[float, int]:
    """Return how many times the cost grows at most from any number of callers to a larger one, and to which."""
    return max((us[many] / min(us[few] for few in us if few <= many), many) for many in us)


def _goals(costs: Costs) -> Iterator[Goal]:
    for depth in DEPTHS:
        of_depth = {load: us for (load, of), us in costs.items() if of == depth and load != _ALONE}
        times, waiters, load = max((*growth(us), load) for load, us in of_depth.items())
        most = f"most: {load}, {waiters:,} callers"
        yield at_most(f"growth of the CPU of a request with the callers, depth {depth}; {most}", times, GROWTH)


def _table(costs: Costs) -> Table:
    counts = [waiters for waiters in WAITERS if any(waiters in us for us in costs.values())]
    return table(
        "Callers at once, in memory: CPU of each request, µs",
        ("requests", "depth", *(f"{waiters:,}" for waiters in counts), "growth"),
        [
            (load, depth, *(f"{us[n]:.1f}" if n in us else "-" for n in counts), f"{growth(us)[0]:.2f}x")
            for (load, depth), us in sorted(costs.items())
        ],
        [
            "The columns are numbers of callers: tasks that wait for one response each of a board in the same process.",
            "Growth: the most by which a request gets dearer from any number of callers to a larger one.",
            f'"-": not tried, because a smaller number had made a request more than {_HOPELESS:.0f} times as dear.',
            "asyncio alone: the same tasks with a semaphore and one turn of the event loop in place of the request.",
        ],
    )
