"""A fake board at the end of a pipe: it answers in order, each request after 4 ms, or the delay of its fate.

Where the addresses of `servolink.testing.FakeBoard` lead to a board that works, here a test sees each byte, and when.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Awaitable
from contextlib import asynccontextmanager
from typing import Any

from servolink.client.board import Board
from servolink.client.connecting import connect
from servolink.connection import Connection, ConnectionOptions, Stats
from servolink.errors import ConnectionLost
from servolink.protocol import ByteOrder, FrameParser, Packet
from servolink.testing import FakeBoard, Fate
from servolink.transports import Receiver
from servolink.virtual import RequestContext, Response, VirtualBoard

LATENCY = 0.004
LOST = Fate(executes=False)
SWALLOWED = Fate(answers=False)
"""Done, and not answered."""


def late(seconds: float) -> Fate:
    """Answer after `seconds`, and not before the usual time."""
    return Fate(delay=seconds)


def lie(packet: Packet) -> Fate:
    """Answer with `packet`."""
    return Fate(says=packet)


class PipedBoard(FakeBoard):
    """Such a board, and the transport to it."""

    takes_at_once = True
    is_stream = True

    def __init__(self, *, servos: int = 4, usual: Fate | None = None, byte_order: ByteOrder = "little") -> None:
        super().__init__(servos, byte_order=byte_order, usual=usual)
        self.url = "fake://board"
        self.sent: list[tuple[float, Packet]] = []
        """All that was sent to it, with the time."""
        self.executed: list[tuple[float, Packet]] = []
        """What of that it has executed."""
        self.answered_at: list[float] = []
        self.taking: asyncio.Event | None = None
        """While it is there and not set, `send` does not return."""
        self.greeting = False
        """While it is True, requests are answered at once as usual and forgotten, for the handshake of `opened`."""
        self.closed = 0
        self.gone: Exception | None = None
        self._outbox: deque[bytes] = deque()
        self._free_at = 0.0
        self._said: list[bytes] = []
        self._session = self.attach(self._said.append)
        self._parser = FrameParser(byte_order)
        self._receiver: Receiver | None = None

    def sent_of(self, declared: type[Packet]) -> list[float]:
        """Return when packets of this kind were sent."""
        return [at for at, packet in self.sent if isinstance(packet, declared)]

    def executed_of(self, declared: type[Packet]) -> list[Packet]:
        """Return the packets of this kind that the board got."""
        return [packet for _, packet in self.executed if isinstance(packet, declared)]

    def speak(self, *packets: Packet) -> None:
        """Say something that nobody asked for."""
        self.deliver(b"".join(map(self.codec.encode, packets)))

    def deliver(self, data: bytes) -> None:
        """Bring bytes to the client now."""
        assert self._receiver is not None
        self._receiver.data(data)

    def vanish(self, error: Exception | None = None) -> None:
        """Be gone, as an unplugged board is."""
        assert self._receiver is not None
        if self.gone is None:
            self.gone = error or OSError("device disconnected")
            self._receiver.lost(self.gone)

    def handle(self, context: RequestContext[Any]) -> tuple[Response, float]:
        """Execute a request. Its fate is that of the pipe, which answers while the board works on."""
        return VirtualBoard.handle(self, context)

    async def open(self, receiver: Receiver) -> None:
        self._receiver = receiver

    async def send(self, data: bytes) -> None:
        if (taking := self.take(data)) is not None:
            await taking

    def take(self, data: bytes) -> Awaitable[object] | None:
        if self.gone is not None:
            raise ConnectionLost(f"{self.url}: the connection was lost: {self.gone}")
        for packet_id, content in self._parser.feed(data):
            self._take(self.codec.decode(packet_id, content), data)
        return None if self.taking is None else self.taking.wait()

    async def close(self) -> None:
        self.closed += 1
        if self.gone is None and self._receiver is not None:
            self.gone = ConnectionLost("closed")
            self._receiver.lost(None)

    def _take(self, packet: Packet, frame: bytes) -> None:
        now = asyncio.get_running_loop().time()
        if self.greeting:
            self._greet(frame, now)
            return
        fate = self._fate = self.fate_of(packet)
        self.sent.append((now, packet))
        if fate.unplugs:
            self.vanish()
            return
        self._said.clear()
        if fate.executes:
            self.executed.append((now, packet))
            self._session.receive(frame, now)
        if fate.says is not None:
            self._said[:] = filter(None, [self.frame(packet.packet_id, fate.says)])
        if fate.answers:
            for answer in self._said:
                self._answer_at(now + max(LATENCY, fate.delay), answer)

    def _greet(self, frame: bytes, now: float) -> None:
        self._fate = Fate()
        self._said.clear()
        self._session.receive(frame, now)
        asyncio.get_running_loop().call_soon(self.deliver, b"".join(self._said))

    def _answer_at(self, when: float, data: bytes) -> None:
        self._free_at = max(self._free_at, when)  # behind a late answer all later ones wait
        self._outbox.append(data)
        asyncio.get_running_loop().call_at(self._free_at, self._answer)

    def _answer(self) -> None:
        data = self._outbox.popleft()
        if self.gone is None:
            self.answered_at.append(asyncio.get_running_loop().time())
            self.deliver(data)


@asynccontextmanager
async def connected(board: PipedBoard, *, handshake: bool = False, **options: Any) -> AsyncIterator[Connection]:
    """Open a connection to `board`, and close it. It works at its whole depth, unless the options say otherwise."""
    options = {"byte_order": board.codec.byte_order, "write_depth": options.get("depth", 1), "learn": False} | options
    own = {name: options.pop(name) for name in ConnectionOptions.__struct_fields__ if name in options}
    connection = Connection(board, ConnectionOptions(**own), **options)
    await connection.open(handshake=handshake)
    try:
        yield connection
    finally:
        await connection.close()


@asynccontextmanager
async def opened(fake: PipedBoard, **options: Any) -> AsyncIterator[Board]:
    """Connect to `fake`, which forgets the handshake: what it was sent, and what was planned, begins behind it.

    The connection works at its whole depth.
    """
    fake.greeting = True
    async with connect(fake, **options) as board:
        fake.greeting = False
        forget(board)
        if "depth" in options:
            work_at(board, options["depth"])
        yield board


def work_at(board: Board, depth: int) -> None:
    """Let a board be asked `depth` requests at once from now on, whatever pays."""
    connection = board.connection
    assert isinstance(connection, Connection)
    window = connection.scheduler.window
    window.learns = False
    window.queries.depth = window.writes.depth = depth


def forget(board: Board) -> None:
    """Set the counters of `board` back to 0."""
    fresh = Stats()
    for name, value in vars(fresh).items():
        if isinstance(value, int):
            setattr(board.stats, name, value)
    board.stats.round_trips.clear()


async def turns_of_the_loop(count: int) -> None:
    """Let the event loop go round `count` times."""
    for _ in range(count):
        await asyncio.sleep(0)


def now() -> float:
    """Return the loop's time."""
    return asyncio.get_running_loop().time()
