"""A board that lies: what comes back is whatever a test says, when it says; nothing of it need be true."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from contextlib import asynccontextmanager
from typing import Any, TypeAlias

from servolink.client import Board, connect
from servolink.errors import ConnectionLost
from servolink.protocol import FrameParser, Packet
from servolink.transports import Receiver
from servolink.virtual import VirtualBoard

Speech: TypeAlias = Iterable[tuple[float, bytes]]
"""Seconds since what was said before, and bytes; it may be endless, if its pauses are not 0."""
Lie: TypeAlias = Callable[[Packet, bytes], Speech]
"""What a board says to a request, given the truth."""

LATENCY = 0.004


def truth(packet: Packet, answer: bytes) -> Speech:
    """Say what is true."""
    if answer:
        yield LATENCY, answer


class LyingBoard:
    """A transport with such a board behind it; `unasked` is what it says by itself."""

    is_recorded = True  # the handshake is the same each time, and so is what becomes of a lie

    def __init__(
        self, lie: Lie = truth, unasked: Speech = (), *, board: VirtualBoard | None = None, url: str = "lying://board"
    ) -> None:
        self.url = url
        self.lie = lie
        self.said = 0
        """How many bytes the client got."""
        self.asked: list[Packet] = []
        """All requests that came."""
        self._unasked = unasked
        self.virtual = board or VirtualBoard(4)
        """What knows the truth."""
        self._codec = self.virtual.codec
        self._parser = FrameParser(self._codec.byte_order)
        self._truth: list[bytes] = []
        self._board = self.virtual.attach(self._truth.append)
        self._receiver: Receiver | None = None
        self._speeches: dict[Iterator[tuple[float, bytes]], asyncio.TimerHandle] = {}

    async def open(self, receiver: Receiver) -> None:
        self._receiver = receiver
        self._begin(self._unasked)

    @asynccontextmanager
    async def after_the_handshake(self, **options: Any) -> AsyncIterator[Board]:
        """Connect to it, and lie only from then on."""
        lie, unasked = self.lie, self._unasked
        self.lie, self._unasked = truth, ()
        async with connect(self, **options) as board:
            self.lie = lie
            self._begin(unasked)
            yield board

    async def send(self, data: bytes) -> None:
        if self._receiver is None:
            raise ConnectionLost("the board has gone")
        now = asyncio.get_running_loop().time()
        for packet_id, content in self._parser.feed(data):
            packet = self._codec.decode(packet_id, content)
            self.asked.append(packet)
            self._truth.clear()
            self._board.receive(self._codec.encode(packet, unchecked=True), now)
            self._begin(self.lie(packet, b"".join(self._truth)))

    async def close(self) -> None:
        receiver, self._receiver = self._receiver, None
        self.repent()
        if receiver is not None:
            receiver.lost(None)

    def speak(self, data: bytes) -> None:
        """Say something at once."""
        assert self._receiver is not None
        self.said += len(data)
        self._receiver.data(data)

    def repent(self) -> None:
        """Say nothing more of what it wanted to say, and the truth from now on."""
        self.lie = truth
        for timer in self._speeches.values():
            timer.cancel()
        self._speeches.clear()

    def _begin(self, speech: Speech) -> None:
        self._go_on(iter(speech))

    def _go_on(self, speech: Iterator[tuple[float, bytes]]) -> None:
        self._speeches.pop(speech, None)
        following = next(speech, None)
        if following is not None and self._receiver is not None:
            pause, chunk = following
            loop = asyncio.get_running_loop()
            self._speeches[speech] = loop.call_later(pause, self._say, speech, chunk)

    def _say(self, speech: Iterator[tuple[float, bytes]], chunk: bytes) -> None:
        if self._receiver is not None:
            self.speak(chunk)
        self._go_on(speech)
