"""Several requests on a line at once, over a pseudo-terminal: beside a loop that does no more than write and read."""

from __future__ import annotations

import asyncio
import gc
import os
import selectors
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from statistics import median
from time import perf_counter_ns, process_time_ns
from typing import ClassVar

from benchmarks.answers import answers, exchange
from benchmarks.goals import Goal, at_most
from benchmarks.measuring import Result, Table, table
from benchmarks.neighbours import Neighbours
from benchmarks.responder import Responder, language
from servolink.client.connecting import connect
from servolink.protocol.codec import Codec

DEPTHS = (4, 16)
DEEPEST = 16
CPU = {4: 2.5, 16: 3.5}
"""How many times the CPU of a request with a future for each, by depth: the least that a program with tasks needs."""
_SIZE = 186


class Bare:
    """The bare loop: writes as many requests as were answered, and counts bytes."""

    name: ClassVar[str] = "os.write, epoll, os.read"

    def __init__(self, path: str, depth: int) -> None:
        """Open the port."""
        query, answer = exchange(_SIZE)
        self._frame, self._size, self._depth = Codec().encode(query), len(answer), depth
        self._port = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._port, selectors.EVENT_READ)

    def ask(self, times: int) -> None:
        """Make so many requests."""
        port, frame, size, select = self._port, self._frame, self._size, self._selector.select
        asked = answered = came = 0
        while answered < times:
            while asked < times and asked - answered < self._depth:
                os.write(port, frame)
                asked += 1
            select()
            came += len(os.read(port, 4096))
            answered = came // size

    def close(self) -> None:
        """Close the port."""
        self._selector.close()
        os.close(self._port)


class _Tasks(ABC):
    """As many tasks as the depth, each of which makes one request after the other."""

    name: ClassVar[str]

    def __init__(self, path: str, depth: int) -> None:
        """Connect on a loop of its own."""
        self._query, self._answer = exchange(_SIZE)
        self._depth = depth
        self._runner = asyncio.Runner()
        self._runner.run(self._open(path))

    def ask(self, times: int) -> None:
        """Make so many requests."""
        self._runner.run(self._ask(times))

    def close(self) -> None:
        """Close port and loop."""
        self._runner.run(self._close())
        self._runner.close()

    async def _ask(self, times: int) -> None:
        request = self._request()
        async with asyncio.TaskGroup() as group:
            for _ in range(self._depth):
                group.create_task(_in_turn(request, times // self._depth))

    @abstractmethod
    async def _open(self, path: str) -> None:
        """Open the port at `path`."""

    @abstractmethod
    def _request(self) -> Callable[[], Awaitable[object]]:
        """Return a function that makes one request."""

    @abstractmethod
    async def _close(self) -> None:
        """Close the port."""


async def _in_turn(request: Callable[[], Awaitable[object]], times: int) -> None:
    for _ in range(times):
        await request()


class Futures(_Tasks):
    """The least that a program with a task for each request has to do: a future for each, resolved in order."""

    name = "add_reader, a future for each"

    async def _open(self, path: str) -> None:
        self._loop = asyncio.get_running_loop()
        self._port = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._came = 0
        self._loop.add_reader(self._port, self._read)

    def _read(self) -> None:
        self._came += len(os.read(self._port, 4096))
        while self._came >= len(self._answer):
            self._came -= len(self._answer)
            self._waiting.popleft().set_result(None)

    def _request(self) -> Callable[[], Awaitable[object]]:
        frame = Codec().encode(self._query)

        def request() -> asyncio.Future[None]:
            self._waiting.append(future := self._loop.create_future())
            os.write(self._port, frame)
            return future

        return request

    async def _close(self) -> None:
        self._loop.remove_reader(self._port)
        os.close(self._port)


class Ours(_Tasks):
    """A board."""

    name = "servolink, board.request"

    async def _open(self, path: str) -> None:
        self._board = await connect(path, depth=self._depth, patience=60)

    def _request(self) -> Callable[[], Awaitable[object]]:
        return lambda: self._board.request(self._query)

    async def _close(self) -> None:
        await self._board.close()


@dataclass
class _Case:
    client: Bare | _Tasks
    depth: int
    rate: list[float] = field(default_factory=list)
    """Requests per second of each round."""
    cpu: list[float] = field(default_factory=list)
    """Microseconds of CPU of a request in each round."""

    def measure(self, times: int) -> None:
        gc.collect()
        began, cpu = perf_counter_ns(), process_time_ns()
        self.client.ask(times)
        self.rate.append(times / (perf_counter_ns() - began) * 1e9)
        self.cpu.append((process_time_ns() - cpu) / times / 1000)


def run(*, short: bool) -> Result:
    """Measure all clients at all depths in turns."""
    rounds, times = (1, 160) if short else (11, 3200)
    neighbours = Neighbours()
    with ExitStack() as stack:
        cases = []
        for depth in DEPTHS:
            for kind in (Bare, Futures, Ours):
                responder = Responder(answers())
                stack.callback(responder.close)
                cases.append(_Case(kind(responder.path, depth), depth))
                stack.callback(cases[-1].client.close)
        for case in cases:
            case.client.ask(DEEPEST)
        for at in range(rounds):
            for case in cases if at % 2 else reversed(cases):
                case.measure(times)
    return {
        "tables": [_table(cases, neighbours.note())],
        "goals": list(_goals(cases)),
        "cases": [
            {"client": case.client.name, "depth": case.depth, "rate": case.rate, "cpu": case.cpu} for case in cases
        ],
    }


def _bare(cases: list[_Case], depth: int) -> _Case:
    return next(case for case in cases if isinstance(case.client, Bare) and case.depth == depth)


def _share(case: _Case, bare: _Case) -> float:
    return median(one / other for one, other in zip(case.rate, bare.rate, strict=True))


def _times(case: _Case, bare: _Case) -> float:
    return median(one / other for one, other in zip(case.cpu, bare.cpu, strict=True))


def _goals(cases: list[_Case]) -> Iterator[Goal]:
    for depth, most in CPU.items():
        futures, ours = (
            next(case for case in cases if isinstance(case.client, kind) and case.depth == depth)
            for kind in (Futures, Ours)
        )
        yield at_most(f"CPU of a request over that with a future for each, depth {depth}", _times(ours, futures), most)


def _table(cases: list[_Case], others: str) -> Table:
    return table(
        f"responses of {_SIZE} bytes over a pseudo-terminal, several requests at once",
        ("client", "depth", "requests/s", "of the bare loop", "CPU, µs", "times the bare loop"),
        [
            (
                case.client.name,
                case.depth,
                f"{median(case.rate):,.0f}",
                f"{_share(case, bare):.0%}",
                f"{median(case.cpu):.1f}",
                f"{_times(case, bare):.2f}x",
            )
            for case in cases
            for bare in [_bare(cases, case.depth)]
        ],
        [
            f"The other end is a program in {language()} on another core, which answers each request with one write.",
            "The bare loop writes each request by itself, reads up to 4 KB and counts bytes; it looks at no frame.",
            others,
        ],
    )
