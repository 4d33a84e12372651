"""Many programs at one hub, in memory: who waits for whom, and how often the board is asked for those who watch."""

from __future__ import annotations

import asyncio
import json
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from time import process_time

from servolink.client.connecting import connect
from servolink.control.greeting import Greeting
from servolink.hub.hub import Hub, share
from servolink.hub.methods.control_session import ControlInterface
from servolink.protocol.codec import Codec
from servolink.protocol.editing import QueryActionRequest, QueryActionResponse
from servolink.protocol.frame import MAGIC
from servolink.protocol.parser import FrameParser
from servolink.protocol.servos import QueryServoListRequest
from servolink.transports.lifecycle import BaseTransport
from servolink.virtual.board import VirtualBoard
from servolink.virtual.transport import VirtualTransport

FLOODING = 31
KEPT = 64
"""Requests that each program that floods has waiting."""
_SETTLE = 0.5  # seconds until all watch


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


@dataclass(frozen=True)
class Watchers:
    """What watching cost."""

    count: int
    hz: float
    readings_per_second: float
    """Of each."""
    polls_per_second: float
    """Of the board."""
    cpu: float
    """Of one core, with the board."""


class _Watcher:
    """A program at the control interface that acknowledges every reading at once."""

    def __init__(self, hub: Hub, control: ControlInterface, number: int, hz: float) -> None:
        self.readings = 0
        greeting = Greeting(wants="rpc", who=f"watcher {number}", role="watch")
        self._loop = asyncio.get_running_loop()
        self.channel = control.open_channel(hub, greeting, f"watcher {number}", self._hear, lambda _: None)
        self._say("servos.watch", {"hz": hz}, id=1)

    def _say(self, method: str, params: dict[str, float], **request_id: int) -> None:
        request = {"jsonrpc": "2.0", "method": method, "params": params, **request_id}
        self.channel.receive(json.dumps(request).encode())

    def _hear(self, message: bytes) -> None:
        heard = json.loads(message)
        if heard.get("method") == "servos":
            self.readings += 1
            self._loop.call_soon(self._say, "servos.ack", {"number": heard["params"]["number"]})


async def watch(count: int, hz: float, seconds: float) -> Watchers:
    """Let so many programs watch the servos of a virtual board for so long."""
    virtual = VirtualTransport(VirtualBoard(servos=16))
    async with AsyncExitStack() as stack:
        upstream = await stack.enter_async_context(connect(virtual, angle_unit=None))
        hub = await stack.enter_async_context(share(upstream, name="bench"))
        control = ControlInterface(hub)
        stack.push_async_callback(control.close)
        watchers = [_Watcher(hub, control, number, hz) for number in range(count)]
        for watcher in watchers:
            stack.push_async_callback(watcher.channel.close)
        await asyncio.sleep(_SETTLE)
        before = sum(watcher.readings for watcher in watchers), upstream.stats.frames_sent, process_time()
        await asyncio.sleep(seconds)
        readings, sent, cpu = sum(watcher.readings for watcher in watchers), upstream.stats.frames_sent, process_time()
        return Watchers(
            count,
            hz,
            (readings - before[0]) / count / seconds,
            (sent - before[1]) / seconds,
            (cpu - before[2]) / seconds,
        )
