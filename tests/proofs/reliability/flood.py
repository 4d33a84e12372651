"""Button events without end for a reader that has stopped reading: memory stays, every lost event is counted."""

from __future__ import annotations

import asyncio

from benchmarks.measuring import Result, table
from servolink.client import Board, Session
from servolink.connection import Connection
from servolink.motion import MotionLimits, MotionPlanner
from servolink.protocol import ButtonEventResponse, Codec, SubscribeButtonEventResponse
from servolink.transports import Receiver
from tests.proofs.reliability.clock import SimulatedLoop
from tests.proofs.reliability.process import Held

_LIMIT = 256
_BURST = 500  # events in a chunk
_MOST_GROWTH = 5_000_000


class _PushingBoard:
    """A transport that grants every subscription and then pushes as many events as it is told."""

    url = "pushing://board"

    def __init__(self) -> None:
        self.pushed = 0
        self._codec = Codec()

    async def open(self, receiver: Receiver) -> None:
        self._receiver = receiver

    async def send(self, data: bytes) -> None:
        answer = self._codec.encode(SubscribeButtonEventResponse(1))
        asyncio.get_running_loop().call_soon(self._receiver.data, answer)

    async def close(self) -> None:
        self._receiver.lost(None)

    def push(self, count: int) -> None:
        numbers = range(self.pushed, self.pushed + count)
        self._receiver.data(b"".join(self._codec.encode(ButtonEventResponse(number, 1)) for number in numbers))
        self.pushed += count


async def _flood(events: int) -> Result:
    transport = _PushingBoard()
    link = Connection(transport)
    await link.open(handshake=False)
    board = Board(Session(link), None, MotionPlanner(MotionLimits()))
    async with board.button_events(_LIMIT) as reader:
        transport.push(10 * _BURST)
        before = highest = Held.now().memory
        while transport.pushed < events:
            transport.push(min(_BURST, events - transport.pushed))
            if transport.pushed % (200 * _BURST) == 0:
                highest = max(highest, Held.now().memory)
                await asyncio.sleep(0)
        kept = [(await anext(reader)).button_id for _ in range(_LIMIT)]
        dropped = reader.dropped
    await board.close()
    return {
        "events": events,
        "dropped": dropped,
        "expected": events - _LIMIT,
        "kept the latest": kept == list(range(events - _LIMIT, events)),
        "growth": highest - before,
    }


def run(*, short: bool) -> Result:
    """Push ten million events (short: 100,000) past a reader that keeps 256."""
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        figures = runner.run(_flood(100_000 if short else 10_000_000))
    wrong = []
    if figures["dropped"] != figures["expected"] or not figures["kept the latest"]:
        wrong.append(f"{figures['dropped']} events are counted as dropped, {figures['expected']} were")
    if figures["growth"] > _MOST_GROWTH:
        wrong.append(f"{figures['events']} events that nobody read took {figures['growth']} bytes")
    quote = table(
        "button events for a reader that has stopped reading",
        ("events", "kept", "dropped and counted", "memory grew by"),
        [(f"{figures['events']:,}", _LIMIT, f"{figures['dropped']:,}", f"{figures['growth'] / 1e6:.1f} MB")],
    )
    return {"tables": [quote], "wrong": wrong, "figures": figures}
