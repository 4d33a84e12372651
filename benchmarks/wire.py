"""The share of a line that is used, in virtual time: the model has no CPU, so only waiting counts."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from benchmarks.answers import answers, exchange
from benchmarks.goals import Goal, at_least, at_most
from benchmarks.instant import requests
from benchmarks.measuring import Result, Table, table
from servolink.client.connecting import connect
from servolink.protocol.codec import Codec
from servolink.transports.lifecycle import BaseTransport
from tests.virtual_time import VirtualTimeLoop

DEPTHS = (1, 2, 4, 8, 16)
STOP = 50.0
"""Milliseconds, at most, until all responses have left the board that it owes when a stop is sent."""
_SIZE = 186


@dataclass(frozen=True)
class Line:
    """A full-duplex line to a board that answers in order."""

    name: str
    bytes_per_second: float
    turnaround: float
    """Seconds from the end of a request to the beginning of its response; requests overlap in it."""
    latency: float = 0.0
    """Seconds for which an adapter collects what comes from the board, from its first byte on."""
    seconds: float = 60.0
    """How long it is watched."""
    share: float = 0.98
    """The goal: of the line, with the greatest depth allowed."""


LINES = (
    Line("115,200 baud", 11_520, 0.0, share=0.99),
    Line("FTDI adapter, 115,200 baud", 11_520, 0.001, 0.016),
    Line("USB CDC, 1 MB/s", 1_000_000, 0.001, seconds=3.0, share=0.95),
)


class LineTransport(BaseTransport):
    """One end of such a line, on the running loop's time."""

    def __init__(self, line: Line) -> None:
        """Lead to a board that answers from a table."""
        super().__init__(f"line://{line.name}")
        self._line = line
        self._answers = answers()
        self._sent_until = self._received_until = 0.0
        self._coming: deque[tuple[float, bytes]] = deque()  # when each byte arrives, in runs that end then
        self.delivered = 0
        """Bytes that the program has."""
        self.most_owed = 0.0
        """Seconds of responses that the board owed at most."""

    async def _open(self) -> None:
        self._loop = asyncio.get_running_loop()

    def _send(self, data: bytes) -> None:
        line, now = self._line, self._loop.time()
        for packet_id, size in requests(data):
            self._sent_until = max(self._sent_until, now) + size / line.bytes_per_second
            answer = self._answers.get(packet_id, b"")
            begin = max(self._received_until, self._sent_until + line.turnaround)
            self._received_until = begin + len(answer) / line.bytes_per_second
            self.most_owed = max(self.most_owed, self._received_until - now)
            if line.latency:
                self._collect(answer, begin)
            else:
                self._loop.call_at(self._received_until, self._arrive, answer)

    def send_now(self, data: bytes) -> None:
        """Send from a callback."""
        self._send(data)

    def _arrive(self, data: bytes) -> None:
        self.delivered += len(data)
        self._deliver(data)

    def _collect(self, answer: bytes, begin: float) -> None:
        """Put the bytes of `answer` into the adapter, one by one."""
        idle = not self._coming
        self._coming.extend(
            (begin + (at + 1) / self._line.bytes_per_second, answer[at : at + 1]) for at in range(len(answer))
        )
        if idle and answer:
            self._loop.call_at(self._coming[0][0] + self._line.latency, self._hand_over)

    def _hand_over(self) -> None:
        """Pass on what has come, and wait again from the next byte on."""
        came = []
        while self._coming and self._coming[0][0] <= self._loop.time():
            came.append(self._coming.popleft()[1])
        if self._coming:
            self._loop.call_at(self._coming[0][0] + self._line.latency, self._hand_over)
        self._arrive(b"".join(came))

    async def _close(self) -> None:
        """Nothing is open."""

    def _abort(self) -> None:
        """Nothing is open."""


def run(*, short: bool) -> Result:
    """Watch 16 servos on each line with each depth as the bound."""
    responses = 64 if short else 640
    part = 0.02 if short else 1.0
    polls = {
        line.name: {depth: _in_virtual_time(line, depth, line.seconds * part) for depth in DEPTHS} for line in LINES
    }
    shares = {name: {depth: poll.share for depth, poll in of_line.items()} for name, of_line in polls.items()}
    limits = {line.name: {depth: limit(line, depth, responses) for depth in DEPTHS} for line in LINES}
    openings = {name: of_line[1].opening for name, of_line in polls.items()}
    owed = max(poll.most_owed for of_line in polls.values() for poll in of_line.values())
    return {
        "tables": [_table(shares, limits, openings)],
        "goals": [
            *_goals(shares),
            at_most("a stop waits for responses that are owed", owed * 1000, STOP, "{:.1f} ms"),
        ],
        "shares": shares,
        "limits": limits,
        "openings": openings,
    }


class Poll(NamedTuple):
    """The outcome of watching 16 servos."""

    share: float
    """Of the line, that responses took."""
    opening: float
    """Seconds."""
    most_owed: float
    """Seconds of responses that the board owed at most."""


def _in_virtual_time(line: Line, depth: int, seconds: float) -> Poll:
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(_poll(line, depth, seconds))


def limit(line: Line, depth: int, responses: int) -> float:
    """Return the share that a client reaches which sends a request for each response, and does nothing else."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(_count(line, depth, responses))


class _Counter:
    """A receiver that answers each whole response with the next request."""

    def __init__(self, transport: LineTransport, responses: int) -> None:
        query, answer = exchange(_SIZE)
        self._transport, self._frame, self._size = transport, Codec().encode(query), len(answer)
        self._left = responses
        self._came = 0
        self.over = asyncio.get_running_loop().create_future()

    async def begin(self, depth: int) -> None:
        for _ in range(depth):
            await self._transport.send(self._frame)

    def data(self, chunk: bytes) -> None:
        self._came += len(chunk)
        while self._came >= self._size and not self.over.done():
            self._came -= self._size
            self._left -= 1
            if not self._left:
                self.over.set_result(None)
            self._transport.send_now(self._frame)

    def lost(self, error: Exception | None) -> None:
        """End with the transport."""


async def _count(line: Line, depth: int, responses: int) -> float:
    loop, transport = asyncio.get_running_loop(), LineTransport(line)
    counter = _Counter(transport, responses)
    await transport.open(counter)
    began = loop.time()
    await counter.begin(depth)
    await counter.over
    share = transport.delivered / line.bytes_per_second / (loop.time() - began)
    await transport.close()
    return share


async def _poll(line: Line, depth: int, seconds: float) -> Poll:
    loop, transport = asyncio.get_running_loop(), LineTransport(line)
    opening = loop.time()
    async with connect(transport, depth=depth, patience=60) as board:
        opening = loop.time() - opening
        await board.servos()  # which sets the angle unit first
        began, before = loop.time(), transport.delivered
        async for _ in board.watch():
            if loop.time() >= began + seconds:
                break
        share = (transport.delivered - before) / line.bytes_per_second / (loop.time() - began)
        return Poll(share, opening, transport.most_owed)


def _goals(shares: dict[str, dict[int, float]]) -> Iterator[Goal]:
    for line in LINES:
        share = shares[line.name][DEPTHS[-1]]
        yield at_least(f"share of the line, {line.name}, start included", share, line.share, "{:.1%}")


def _table(
    shares: dict[str, dict[int, float]], limits: dict[str, dict[int, float]], openings: dict[str, float]
) -> Table:
    return table(
        "Share of the line that the states of 16 servos take",
        ("line", "client", *(f"depth {depth}" for depth in DEPTHS), "opening, ms"),
        [
            (line, client, *(f"{share:.1%}" for share in found[line].values()), opening)
            for line in shares
            for client, found, opening in (
                ("servolink", shares, f"{openings[line] * 1000:.1f}"),
                ("the limit", limits, "-"),
            )
        ],
        [
            "`board.watch()` with this bound (`connect(..., depth=)`), the search for the best depth included.",
            "Watched for a minute on the serial lines, for 3 s on USB.",
            "In virtual time, where programs need no CPU. The limit: as many requests out as the depth, at any time.",
            "The board takes 1 ms on all but the first line. An FTDI adapter passes on what it has after 16 ms.",
            "Opening: from an open port until the program may send its first request.",
        ],
    )
