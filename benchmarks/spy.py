"""A spy between a program and a board, beside the bare line: what it adds to a round trip."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import tty
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from time import perf_counter_ns

from benchmarks.answers import answers
from benchmarks.goals import Goal, at_most
from benchmarks.measuring import CORES, Result, Table, table
from benchmarks.neighbours import Neighbours
from benchmarks.responder import Responder, language
from servolink.protocol.codec import Codec
from servolink.protocol.servos import ALL_SERVOS, QueryServoRequest

MOST_ADDED = 1.0
"""Milliseconds that the spy may add to a round trip, which it passes twice."""
PAUSES = {"one after the other": 0.0, "every 5 ms": 0.005}
"""When the program asks, with the seconds between two requests."""
_STARTING = 60.0  # seconds in which a spy must have made its port
_ASKED = Codec().encode(QueryServoRequest(ALL_SERVOS))


@dataclass
class _Line:
    """A line to a board, and how long round trips on it took."""

    name: str
    port: int
    p50: list[float] = field(default_factory=list)
    """Milliseconds, of each round."""
    p99: list[float] = field(default_factory=list)

    def measure(self, times: int, pause: float) -> None:
        """Ask as a program without any library does."""
        took = []
        for _ in range(times):
            began = perf_counter_ns()
            os.write(self.port, _ASKED)
            left = _SIZE
            while left:
                left -= len(os.read(self.port, left))
            took.append(perf_counter_ns() - began)
            if pause:
                time.sleep(pause)  # a program that asks now and then: each request finds the spy waiting
        took.sort()
        self.p50.append(took[len(took) // 2] / 1e6)
        self.p99.append(took[len(took) * 99 // 100] / 1e6)


_SIZE = len(answers()[QueryServoRequest.packet_id])


def run(*, short: bool) -> Result:
    """Measure the bare line and both kinds of spy in turns."""
    rounds = 3 if short else 15
    neighbours = Neighbours()
    found: dict[str, list[_Line]] = {}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="servolink-spy-")))
        ports = [
            ("bare", _responder(stack)),
            (
                "spy that shows and records",
                stack.enter_context(_spy(_responder(stack), folder, "--record", "out.mcap")),
            ),
            ("spy --quiet", stack.enter_context(_spy(_responder(stack), folder, "--quiet"))),
        ]
        opened = [(name, stack.enter_context(_opened(port))) for name, port in ports]
        for when, pause in PAUSES.items():
            lines = found[when] = [_Line(name, port) for name, port in opened]
            times = (100 if short else 1000) if pause == 0 else (40 if short else 200)
            for line in lines:  # not counted
                _Line(line.name, line.port).measure(50, pause)
            for at in range(rounds):
                for line in lines if at % 2 else reversed(lines):
                    line.measure(times, pause)
    return {
        "tables": [_table(found, neighbours.note())],
        "goals": list(_goals(found)),
        "lines": [
            {"asks": when, "line": line.name, "p50": line.p50, "p99": line.p99}
            for when, lines in found.items()
            for line in lines
        ],
    }


def _responder(stack: ExitStack) -> str:
    responder = Responder(answers())
    stack.callback(responder.close)
    return responder.path


@contextmanager
def _opened(path: str) -> Iterator[int]:
    port = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(port)
    try:
        yield port
    finally:
        os.close(port)


@contextmanager
def _spy(board: str, folder: Path, *options: str) -> Iterator[str]:
    """Run a spy before a board; yield the port for the program."""
    link = folder / f"link{len(list(folder.iterdir()))}"
    command = [sys.executable, "-m", "servolink", "spy", board, "--pty", str(link), *options]
    path = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    with (folder / f"{link.name}.txt").open("wb") as out:
        process = subprocess.Popen(  # noqa: S603 - our own program
            command, cwd=folder, stdout=out, stderr=subprocess.DEVNULL, env={**os.environ, "PYTHONPATH": path}
        )
    if CORES:
        os.sched_setaffinity(process.pid, set(CORES))
    try:
        deadline = time.monotonic() + _STARTING
        while not link.exists():
            if process.poll() is not None:
                raise RuntimeError(f"the spy ended with {process.returncode}")
            if time.monotonic() > deadline:
                raise RuntimeError(f"the spy made no port within {_STARTING:g} s")
            time.sleep(0.01)
        yield str(link)
    finally:
        process.terminate()
        process.wait()


def _added(bare: list[float], spied: list[float]) -> float:
    """Return the milliseconds that a spy adds, round by round."""
    return median(one - other for one, other in zip(spied, bare, strict=True))


def _goals(found: dict[str, list[_Line]]) -> Iterator[Goal]:
    for when, (bare, *spies) in found.items():
        for spy in spies:
            name = f"what a {spy.name} adds to the median of a round trip; requests {when}"
            yield at_most(name, _added(bare.p50, spy.p50), MOST_ADDED, "{:+.2f} ms")


def _table(found: dict[str, list[_Line]], others: str) -> Table:
    rows = []
    for when, lines in found.items():
        for line in lines:
            added = [f"{_added(getattr(lines[0], each), getattr(line, each)):+.2f}" for each in ("p50", "p99")]
            shown = ["", ""] if line is lines[0] else added
            rows.append((when, line.name, f"{median(line.p50):.2f}", f"{median(line.p99):.2f}", *shown))
    return table(
        f"Round trips of {len(_ASKED)} and {_SIZE} bytes on a pair of pseudo-terminals, in ms",
        ("requests", "line", "p50", "p99", "added to p50", "added to p99"),
        rows,
        [
            f"The board is a program in {language()}; the program that asks uses no library, only the system's calls.",
            "The bare line and those with a spy take turns. Times are wall-clock times.",
            others,
        ],
    )
