"""A board that is recorded, beside the same board that is not: what recording takes from those who work."""

from __future__ import annotations

import asyncio
import gc
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from statistics import median
from time import perf_counter_ns, process_time_ns

from benchmarks.answers import answers
from benchmarks.goals import Goal, at_least
from benchmarks.measuring import CORES, Result, Table, table
from benchmarks.neighbours import Neighbours
from benchmarks.responder import Responder, language
from servolink.client.board import Board
from servolink.client.connecting import connect
from servolink.protocol.servos import QueryServoRequest
from servolink.recorder.mcap_reader import McapReader, Message
from servolink.recorder.recorder import record

BOARDS = {"after 1 ms, as over USB": 0.001, "at once": 0.0}
"""When a board responds, with the seconds."""
LEAST = 0.95
"""Of the requests per second without a recorder, on a board that takes as long as a real one."""
_WITH_GOAL = "after 1 ms, as over USB"


@dataclass
class _Case:
    """One way to a board that responds at some speed."""

    way: str
    board: str
    rates: dict[bool, list[float]] = field(default_factory=lambda: {False: [], True: []})
    """Requests per second, without and with a recorder."""
    cpu: dict[bool, list[float]] = field(default_factory=lambda: {False: [], True: []})
    """Microseconds of processor time of the program for each request."""

    async def measure(self, board: Board, times: int, *, recorded: bool) -> None:
        """Ask one thing after the other."""
        gc.collect()
        began, worked = perf_counter_ns(), process_time_ns()
        for _ in range(times):
            await board.request(QueryServoRequest(255))
        self.rates[recorded].append(times * 1e9 / (perf_counter_ns() - began))
        self.cpu[recorded].append((process_time_ns() - worked) / times / 1e3)

    @property
    def share(self) -> float:
        """The rate with a recorder as a share of that without, round by round."""
        return median(one / other for one, other in zip(self.rates[True], self.rates[False], strict=True))


def run(*, short: bool) -> Result:
    """Measure with and without a recorder in turns, alone and on a hub."""
    rounds, seconds = (1, 0.2) if short else (9, 1.0)
    if CORES:  # the recorder is a process of its own
        os.sched_setaffinity(0, set(CORES))
    neighbours = Neighbours()
    cases: list[_Case] = []
    wrong: list[str] = []
    for board, delay in BOARDS.items():
        times = int(seconds * (400 if delay else 4000))
        for measure in (_alone, _on_hub):
            case, missing = asyncio.run(measure(board, delay, rounds, times))
            cases.append(case)
            if missing:
                wrong.append(f"{missing} requests are not in the files; {case.way}, board: {case.board}")
    return {
        "tables": [_table(cases, neighbours.note())],
        "goals": list(_goals(cases)),
        "wrong": wrong,
        "cases": [{"way": each.way, "board": each.board, "rates": list(each.rates.values())} for each in cases],
    }


async def _alone(name: str, delay: float, rounds: int, times: int) -> tuple[_Case, int]:
    """Record in the program that asks, with `servolink.recorder.record`."""
    numbers = count()
    with tempfile.TemporaryDirectory(prefix="servolink-recorder-") as folder:
        responder = Responder(answers(), delay)
        try:
            async with connect(responder.path) as board:

                @asynccontextmanager
                async def recording() -> AsyncIterator[Path]:
                    path = Path(folder, f"{next(numbers)}.mcap")
                    async with record(path, board, hz=0):
                        yield path

                return await _rounds(_Case("alone", name), board, recording, rounds, times)
        finally:
            responder.close()


async def _on_hub(name: str, delay: float, rounds: int, times: int) -> tuple[_Case, int]:
    """Record a hub by a process of its own, while a program asks over TCP."""
    numbers = count(1)
    async with AsyncExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="servolink-recorder-"))
        responder = Responder(answers(), delay)
        stack.callback(responder.close)
        environment = {**os.environ, "XDG_RUNTIME_DIR": folder, "XDG_CONFIG_HOME": folder}
        hub = stack.enter_context(_worker(environment, "benchmarks.hub_worker", responder.path, ""))
        url = next(url for url in json.loads(_line(hub)) if url.startswith("tcp://"))
        recorder = stack.enter_context(_worker(environment, "benchmarks.recorder_worker", "share://bench", folder))
        board = await stack.enter_async_context(connect(url))

        @asynccontextmanager
        async def recording() -> AsyncIterator[Path]:
            await asyncio.to_thread(_tell, recorder)
            try:
                yield Path(folder, f"{next(numbers)}.mcap")
            finally:
                await asyncio.to_thread(_tell, recorder)

        return await _rounds(_Case("beside a program of a hub", name), board, recording, rounds, times)


async def _rounds(
    case: _Case,
    board: Board,
    recording: Callable[[], AbstractAsyncContextManager[Path]],
    rounds: int,
    times: int,
) -> tuple[_Case, int]:
    """Measure with and without a recorder in turns. Return also how many requests are missing in the files."""
    missing = 0
    await _Case("", "").measure(board, times, recorded=False)  # not counted
    for at in range(rounds):
        for recorded in (False, True) if at % 2 else (True, False):
            if not recorded:
                await case.measure(board, times, recorded=False)
                continue
            async with recording() as path:
                await case.measure(board, times, recorded=True)
            missing += max(0, times - _requests_in(path))
            path.unlink()
    return case, missing


def _requests_in(path: Path) -> int:
    """Return how many packets of the kind that was asked for are in a recording."""
    wanted = f'"packet":"{QueryServoRequest.__name__}"'.encode()
    messages = (record for record in McapReader(path).records() if isinstance(record, Message))
    return sum(message.topic == "/packets" and wanted in message.data for message in messages)


@contextmanager
def _worker(environment: dict[str, str], *module_and_words: str) -> Iterator[subprocess.Popen[str]]:
    """Run a module of ours in a process of its own."""
    process = subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-m", *module_and_words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    assert process.stdin is not None  # noqa: S101 - it is a pipe
    try:
        yield process
    finally:
        process.stdin.close()
        process.wait()


def _tell(process: subprocess.Popen[str]) -> str:
    """Send an empty line, and return what comes back."""
    assert process.stdin is not None  # noqa: S101 - it is a pipe
    process.stdin.write("\n")
    process.stdin.flush()
    return _line(process)


def _line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None  # noqa: S101 - it is a pipe
    return process.stdout.readline().strip()


def _goals(cases: list[_Case]) -> Iterator[Goal]:
    for case in cases:
        if case.board == _WITH_GOAL:
            name = f"requests per second with a recorder over those without; {case.way}, board: {case.board}"
            yield at_least(name, 100 * case.share, 100 * LEAST, "{:.1f} %")


def _table(cases: list[_Case], others: str) -> Table:
    size = len(answers()[QueryServoRequest.packet_id])
    return table(
        f"A board with and without a recorder: responses of {size} bytes, one request at a time",
        (
            "recorded",
            "board responds",
            "requests/s without",
            "with",
            "share",
            "CPU, us, without",
            "with",
        ),
        [
            (
                case.way,
                case.board,
                f"{median(case.rates[False]):,.0f}",
                f"{median(case.rates[True]):,.0f}",
                f"{case.share:.1%}",
                f"{median(case.cpu[False]):.1f}",
                f"{median(case.cpu[True]):.1f}",
            )
            for case in cases
        ],
        [
            f"The board is a program in {language()} at a pseudo-terminal; none responds at once.",
            "CPU is that of the program that asks, for each request.",
            "Bytes, packets and commands are recorded, and every request is looked for in the file.",
            "Board, program, hub and recorder share the cores of this machine, and rates are wall-clock figures.",
            others,
        ],
    )
