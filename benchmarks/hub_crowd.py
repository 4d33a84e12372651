"""Many programs at one hub, in memory: who waits for whom."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from servolink.client.connecting import connect
from servolink.hub.hub import Hub, share
from servolink.protocol.codec import Codec
from servolink.protocol.editing import QueryActionRequest, QueryActionResponse
from servolink.protocol.frame import MAGIC
from servolink.protocol.parser import FrameParser
from servolink.protocol.servos import QueryServoListRequest
from servolink.transports.lifecycle import BaseTransport
from servolink.virtual.board import VirtualBoard

FLOODING = 31
KEPT = 64
"""Requests that each program that floods has waiting."""


@dataclass
class Waits:
    """How long one program waited beside others that flood."""

    flooding: int = FLOODING
    kept: int = KEPT
    counts: list[int] = field(default_factory=list)
    """Exchanges of others with the board between each of its requests and its response."""

    def percentile(self, percent: float) -> float:
        """Return a percentile of the counts."""
        ordered = sorted(self.counts)
        return ordered[min(len(ordered) - 1, int(len(ordered) * percent / 100))]


class _CountingBoard(BaseTransport):
    """Answers every request in the next turn of the loop, and counts them."""

    def __init__(self) -> None:
        super().__init__("counting://")
        self.exchanges = 0
        self._codec, self._parser = Codec(), FrameParser()
        self._virtual = VirtualBoard(servos=1)
        self._session = self._virtual.attach(self._deliver_soon)

    def _deliver_soon(self, frame: bytes) -> None:
        asyncio.get_running_loop().call_soon(self._deliver, frame)

    async def _open(self) -> None:
        """Nothing is open."""

    def _send(self, data: bytes) -> None:
        for packet_id, content in self._parser.feed(data):
            self.exchanges += 1
            packet = self._codec.decode(packet_id, content)
            if isinstance(packet, QueryActionRequest):
                self._deliver_soon(self._codec.encode(QueryActionResponse(packet.action_id, "wave")))
            else:
                self._session.receive(self._codec.encode(packet), asyncio.get_running_loop().time())

    async def _close(self) -> None:
        """Nothing is open."""

    def _abort(self) -> None:
        """Nothing is open."""


class _Flood:
    """A program that always has requests waiting, each for another record."""

    def __init__(self, hub: Hub, number: int) -> None:
        self._record_id = number << 20
        self._codec, self._loop = Codec(), asyncio.get_running_loop()
        self._program = hub.join(self._hear, who=f"flood {number}", door="tcp")
        self._ask(KEPT)

    def _hear(self, frames: bytes) -> None:
        self._loop.call_soon(self._ask, frames.count(MAGIC))

    def _ask(self, times: int) -> None:
        for _ in range(times):
            self._record_id += 1
            self._program.receive(self._codec.encode(QueryActionRequest(self._record_id)))


async def starve(times: int) -> Waits:
    """Let one program ask so many times beside others that flood."""
    waits, board = Waits(), _CountingBoard()
    async with connect(board, angle_unit=None) as upstream, share(upstream, name="bench") as hub:
        for number in range(1, FLOODING + 1):
            _Flood(hub, number)
        answered: asyncio.Queue[bytes] = asyncio.Queue()
        program = hub.join(answered.put_nowait, who="the one that waits", door="tcp")
        frame = Codec().encode(QueryServoListRequest())
        await asyncio.sleep(0.05)
        for _ in range(times):
            before = board.exchanges
            program.receive(frame)
            await answered.get()
            waits.counts.append(board.exchanges - before)
    return waits
