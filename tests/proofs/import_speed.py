"""The time that imports take, in virtual time: a model of the line with a virtual board behind it, without CPU."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from collections import deque
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec

from benchmarks.goals import Goal, at_most
from benchmarks.measuring import Result, table
from benchmarks.wire import LINES, Line
from servolink.client import Board, connect
from servolink.project import Project
from servolink.protocol import ACTION, OVERHEAD, Action, Codec, FrameParser, Step, encode_frame
from servolink.transports import BaseTransport
from servolink.virtual import BoardKind, VirtualBoard
from tests.virtual_time import VirtualTimeLoop

SERIAL, FTDI, CDC = LINES
DEPTHS = (1, 4, 8)
_STEPS = 16
_PIECE = 256  # bytes that arrive together
_MANY, _FEW = 1800, 50


class BoardLine(BaseTransport):
    """A full-duplex line to a virtual board, on the running loop's time."""

    def __init__(self, line: Line, board: VirtualBoard) -> None:
        """Lead to `board`, which takes the line's turnaround for each request and queues any number of them."""
        super().__init__(f"line://{line.name}")
        self._line = line
        self._board = board
        if line is not CDC:  # whose rate no program is told
            self.bytes_per_second = line.bytes_per_second
        self._parser = FrameParser()
        self._sent_until = self._received_until = 0.0
        self._coming: deque[tuple[float, bytes]] = deque()  # when the first byte arrives, and the bytes

    async def _open(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._responses: list[bytes] = []
        self._session = self._board.attach(self._responses.append)

    def _send(self, data: bytes) -> None:
        line, now = self._line, self._loop.time()
        for packet_id, content in self._parser.feed(data):
            self._sent_until = max(self._sent_until, now) + (len(content) + OVERHEAD) / line.bytes_per_second
            self._responses.clear()
            self._session.receive(encode_frame(packet_id, content, "little"), now)
            response = b"".join(self._responses)
            begin = max(self._received_until, self._sent_until + line.turnaround)
            self._received_until = begin + len(response) / line.bytes_per_second
            if line.latency:
                self._collect(response, begin)
            else:
                for at in range(0, len(response), _PIECE):
                    piece = response[at : at + _PIECE]
                    self._loop.call_at(begin + (at + len(piece)) / line.bytes_per_second, self._deliver, piece)

    def _collect(self, response: bytes, begin: float) -> None:
        """Put a response into the adapter, which passes on what it has some time after the first byte."""
        if not self._coming and response:
            self._loop.call_at(begin + self._line.latency, self._hand_over)
        self._coming.append((begin, response))

    def _hand_over(self) -> None:
        came, rate, now = [], self._line.bytes_per_second, self._loop.time()
        while self._coming and self._coming[0][0] < now:
            begin, data = self._coming.popleft()
            count = min(len(data), int((now - begin) * rate + 1e-6))
            came.append(data[:count])
            if count < len(data):
                self._coming.appendleft((begin + count / rate, data[count:]))
                break
        if self._coming:
            self._loop.call_at(self._coming[0][0] + self._line.latency, self._hand_over)
        self._deliver(b"".join(came))

    async def _close(self) -> None:
        """Nothing is open."""

    def _abort(self) -> None:
        """Nothing is open."""


class Case(NamedTuple):
    """One piece of work with a library of actions."""

    name: str
    held: int
    """Actions on the board before it, of those that are imported."""
    wanted: int
    changed: int
    """How many of the held ones are different."""
    work: Callable[[Board, Project, Path], Awaitable[object]]


async def _apply(board: Board, project: Project, folder: Path) -> object:
    return await board.apply_project(project, folder=folder)


async def _plan(board: Board, project: Project, folder: Path) -> object:
    return await board.plan_project(project)


async def _export(board: Board, project: Project, folder: Path) -> object:
    return await board.export_project()


APPLY = Case(f"{_MANY:,} actions to an empty board", 0, _MANY, 0, _apply)
PLAN = Case(f"plan of {_MANY:,} actions that are there", _MANY, _MANY, 0, _plan)
CHANGE = Case(f"one of {_MANY:,} actions changed", _MANY, _MANY, 1, _apply)
EXPORT = Case(f"export of {_MANY:,} actions", _MANY, _MANY, 0, _export)
FEW = Case(f"one of {_FEW} actions changed", _FEW, _FEW, 1, _apply)
CASES = (APPLY, PLAN, CHANGE, EXPORT, FEW)
GOALS = (
    (APPLY, SERIAL, 4, 28.0),
    (PLAN, SERIAL, 4, 26.0),
    (CHANGE, SERIAL, 4, 28.0),
    (APPLY, FTDI, 8, 28.0),
    (APPLY, CDC, 8, 0.65),
    (FEW, SERIAL, 1, 1.5),
)
"""Case, line, depth, seconds at most."""


def measure(*, short: bool) -> Result:
    """Do all cases on all lines at all depths; `short` only those that have goals."""
    wanted = {(case, line, depth) for case, line, depth, _ in GOALS}
    wanted |= set() if short else {(case, line, depth) for case in CASES for line in LINES for depth in DEPTHS}
    seconds = {key: seconds_of(*key) for key in wanted}
    rows = [
        (case.name, line.name, *(_text(seconds.get((case, line, depth))) for depth in DEPTHS))
        for case in CASES
        for line in LINES
    ]
    notes = [
        f"Seconds in virtual time, the handshake excluded. Actions have {_STEPS} steps: 127 bytes a response.",
        "Depth: how many requests may be on the line at once (`connect(..., depth=)`).",
    ]
    columns = ("import", "line", *(f"depth {depth}" for depth in DEPTHS))
    return {
        "seconds": [[case.name, line.name, depth, taken] for (case, line, depth), taken in seconds.items()],
        "goals": list(_goals(seconds)),
        "tables": [table("Time of imports", columns, rows, notes)],
    }


def _text(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds:.2f}"


def _goals(seconds: dict[tuple[Case, Line, int], float]) -> Iterator[Goal]:
    for case, line, depth, most in GOALS:
        name = f"seconds for {case.name}, {line.name}, depth {depth}"
        yield at_most(name, seconds[case, line, depth], most, "{:.2f} s")


def seconds_of(case: Case, line: Line, depth: int) -> float:
    """Return the seconds that a piece of work takes."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(_time(case, line, depth))


async def _time(case: Case, line: Line, depth: int) -> float:
    board = VirtualBoard(2, kind=BoardKind(memory=2**20))
    wanted = library(case.wanted)
    held = list(library(case.held).actions)
    for at in range(case.changed):
        held[at * 7 + 5] = msgspec.structs.replace(held[at * 7 + 5], steps=(Step(1, 3, 3),) * _STEPS)
    session, codec = board.attach(lambda _: None), Codec()
    for record in held:
        session.receive(codec.encode(ACTION.add(record)), 0.0)
    board.storage.project_id = wanted.project_id
    folder = Path(tempfile.mkdtemp())
    try:
        async with connect(BoardLine(line, board), depth=depth, write_depth=depth) as connected:
            loop = asyncio.get_running_loop()
            began = loop.time()
            await case.work(connected, wanted, folder)
            return loop.time() - began
    finally:
        shutil.rmtree(folder)


def library(count: int) -> Project:
    """Return a project with so many actions."""
    steps = tuple(Step(1 + at % 2, at, 10) for at in range(_STEPS))
    return Project(7, actions=tuple(Action(at, f"Action {at}", steps) for at in range(1, count + 1)))
