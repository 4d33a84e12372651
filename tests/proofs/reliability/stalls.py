"""Replies that arrive in time while the event loop stands still, and who gives them to the caller.

`wait_for` and `asyncio.timeout` ask the clock, and it depends on the Python what they make of a reply that lies in the
buffer when the clock has run out. Here the loop stands still from before the reply until after the deadline.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
import threading
import time
import tty
from collections.abc import Awaitable, Callable
from pathlib import Path
from platform import python_version

from benchmarks.measuring import Result, table
from servolink.connection import Connection, ConnectionOptions
from servolink.errors import ServolinkError
from servolink.protocol import Codec, FrameParser, QueryProjectIDRequest, QueryProjectIDResponse
from servolink.transports import Receiver, SerialTransport, Transport
from tests import processes
from tests.client.numbered_board import numbered
from tests.proofs.reliability.clock import SimulatedLoop

_TIMEOUT, _STALL, _LATENCY = 0.25, 0.3, 0.004
_REAL_TIMEOUT, _REAL_STALL = 0.02, 0.03
_LIMIT = 3600.0  # seconds for another Python
_END = b"end"
_REQUEST, _REPLY = QueryProjectIDRequest(), Codec().encode(QueryProjectIDResponse(7))

Ask = Callable[[], Awaitable[object]]
Arrived = Callable[[], float]
"""When the latest reply lay ready to be read."""


class _Prompt:
    """A transport whose board replies after 4 ms of virtual time."""

    url = "prompt://board"
    arrived = 0.0

    async def open(self, receiver: Receiver) -> None:
        self._loop = asyncio.get_running_loop()
        assert isinstance(self._loop, SimulatedLoop)
        self._receiver = receiver
        self._loop.read_device(receiver.data)

    async def send(self, data: bytes) -> None:
        assert isinstance(self._loop, SimulatedLoop)
        self.arrived = self._loop.now + _LATENCY
        self._loop.bring(self.arrived, _REPLY)

    async def close(self) -> None:
        self._receiver.lost(None)


class _Plain:
    """A future, a transport and one of asyncio's ways to limit time."""

    def __init__(self, transport: Transport, timeout: float, *, wait_for: bool) -> None:
        self._transport, self._timeout, self._wait_for = transport, timeout, wait_for
        self._reply: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()

    def data(self, chunk: bytes, /) -> None:
        if not self._reply.done():
            self._reply.set_result(chunk)

    def lost(self, error: Exception | None, /) -> None:
        if not self._reply.done():
            self._reply.cancel()

    async def ask(self) -> bytes:
        self._reply = asyncio.get_running_loop().create_future()
        await self._transport.send(Codec().encode(_REQUEST))
        if self._wait_for:
            return await asyncio.wait_for(self._reply, self._timeout)  # noqa: TID251 - this is what is measured
        async with asyncio.timeout(self._timeout):
            return await self._reply


async def _count_lost(ask: Ask, arrived: Arrived, timeout: float, stall: Callable[[], object], count: int) -> int:
    """Ask so often, stall each time, and count the replies that came in time and that the caller does not get."""
    lost, loop = 0, asyncio.get_running_loop()
    for _ in range(count):
        begun = loop.time()
        asking = asyncio.ensure_future(ask())
        await asyncio.sleep(0)
        stall()
        try:
            await asking
        except (ServolinkError, TimeoutError):
            lost += begun <= arrived() <= begun + timeout
        await asyncio.sleep(0.005)  # a reply that came late must not help the next
    return lost


async def _lost(
    make: Callable[[], Transport], arrived: Arrived, timeout: float, stall: Callable[[], object], count: int
) -> list[int]:
    """Return what is lost with `wait_for`, with `asyncio.timeout`, and by the library."""
    lost = []
    for wait_for in (True, False):
        transport = make()
        plain = _Plain(transport, timeout, wait_for=wait_for)
        await transport.open(plain)
        lost.append(await _count_lost(plain.ask, arrived, timeout, stall, max(1, count // 10)))
        await transport.close()
    link = Connection(make(), ConnectionOptions(patience=timeout))
    await link.open(handshake=False)
    lost.append(await _count_lost(lambda: link.request(_REQUEST), arrived, timeout, stall, count))
    await link.close()
    return lost


async def _virtual(count: int) -> list[int]:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, SimulatedLoop)
    made: list[_Prompt] = []

    def make() -> _Prompt:
        made.append(_Prompt())
        return made[-1]

    return await _lost(make, lambda: made[-1].arrived, _TIMEOUT, lambda: loop.stall(_STALL), count)


class _Responder(threading.Thread):
    """Replies at the other end of a pseudo-terminal, as fast as the system lets a thread run."""

    def __init__(self, terminal: int) -> None:
        super().__init__()
        self.arrived = 0.0
        self._terminal = terminal
        self._codec, self._parser = Codec(), FrameParser()

    def run(self) -> None:
        while (data := os.read(self._terminal, 4096)) != _END:
            for frame in self._parser.feed(data):
                os.write(self._terminal, self._codec.encode(numbered(self._codec.decode(*frame), 7)))
                self.arrived = time.monotonic()


async def _real(count: int) -> list[int]:
    """Do the same in real time over a pseudo-terminal."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    name = os.ttyname(theirs)
    responder = _Responder(ours)
    responder.start()
    try:
        return await _lost(
            lambda: SerialTransport(f"serial://{name}", name),
            lambda: responder.arrived,
            _REAL_TIMEOUT,
            lambda: time.sleep(_REAL_STALL),  # the loop is to stand still
            count,
        )
    finally:
        os.write(theirs, _END)
        responder.join()
        os.close(ours)
        os.close(theirs)


def measure(count: int, *, real: bool) -> list[int]:
    """Return what is lost on this Python: of a tenth of `count` with either of asyncio's ways, of `count` by us."""
    with asyncio.Runner(loop_factory=None if real else SimulatedLoop) as runner:
        return runner.run((_real if real else _virtual)(count))


def run(*, short: bool, pythons: tuple[str, ...] = (sys.executable,), real: bool = False) -> Result:
    """Stall 10,000 times (short: 500) on each Python: in virtual time, and with `real` also over a pseudo-terminal."""
    count, rows, figures, wrong = 500 if short else 10_000, [], {}, []
    for python in pythons:
        for over_pty in (False, True) if real else (False,):
            version, lost = _on(python, count, real=over_pty)
            where = "a pseudo-terminal, real time" if over_pty else "virtual time"
            figures[f"{version}, {where}"] = lost
            rows.append(
                (version, where, *(f"{number:,} of {of:,}" for number, of in zip(lost, _asked(count), strict=True)))
            )
            if lost[-1]:
                wrong.append(f"Python {version}, {where}: {lost[-1]} replies that came in time were lost")
    quote = table(
        "responses that arrived before their deadline and were lost because the event loop was busy until after it",
        ("Python", "over", "asyncio.wait_for", "asyncio.timeout", "servolink"),
        rows,
    )
    return {"tables": [quote], "wrong": wrong, "figures": {"count": count, "lost": figures}}


def _asked(count: int) -> tuple[int, int, int]:
    return max(1, count // 10), max(1, count // 10), count


def _on(python: str, count: int, *, real: bool) -> tuple[str, list[int]]:
    """Measure on another Python, which needs the dependencies of servolink."""
    if python == sys.executable:
        return python_version(), measure(count, real=real)
    command = [python, "-m", "tests.proofs.reliability.stalls", str(count), *(["--real"] if real else [])]
    done = processes.run(command, cwd=Path(__file__).parents[3], check=True, limit=_LIMIT)
    version, lost = json.loads(done.stdout)
    return version, lost


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("count", type=int)
    arguments.add_argument("--real", action="store_true")
    given = arguments.parse_args()
    print(json.dumps([python_version(), measure(given.count, real=given.real)]))
