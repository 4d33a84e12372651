"""A board behind a line of a certain pace, which handles one request after the other."""

from __future__ import annotations

import asyncio
from collections import deque
from random import Random

from servolink.protocol import Packet
from tests.client.piped_board import PipedBoard

SERIAL = 11_520.0
"""Bytes per second at 115,200 baud."""


class LineBoard(PipedBoard):
    """Such a board: it begins with a request when the response to the one before has left."""

    def __init__(
        self, pace: float = SERIAL, *, servos: int = 16, turnaround: float = 0.001, room: int = 64, loss: float = 0.0
    ) -> None:
        super().__init__(servos=servos)
        self.pace = pace
        self.turnaround = turnaround
        """Seconds from the beginning of a request until its response begins to leave."""
        self.room = room
        """How many requests it keeps besides the one that it handles; it loses the others."""
        self.latency = 0.0
        """Seconds that a response is on its way after it has left."""
        self.loss = loss
        """The share of responses that the line loses."""
        self.overflows = 0
        self._chance = Random(11)
        self._sent_until = 0.0
        self._queue: deque[tuple[Packet, bytes]] = deque()
        self._busy = False

    def _take(self, packet: Packet, frame: bytes) -> None:
        loop = asyncio.get_running_loop()
        self.sent.append((loop.time(), packet))
        self._sent_until = max(self._sent_until, loop.time()) + len(frame) / self.pace
        loop.call_at(self._sent_until, self._arrive, packet, frame)

    def _arrive(self, packet: Packet, frame: bytes) -> None:
        if len(self._queue) >= self.room and self._busy:
            self.overflows += 1
            return
        self._queue.append((packet, frame))
        if not self._busy:
            self._handle()

    def _handle(self) -> None:
        self._busy = bool(self._queue)
        if not self._busy:
            return
        packet, frame = self._queue.popleft()
        loop = asyncio.get_running_loop()
        self.executed.append((loop.time(), packet))
        self._said.clear()
        self._session.receive(frame, loop.time())
        answer = b"".join(self._said)
        loop.call_later(self.turnaround + len(answer) / self.pace, self._done, answer)

    def _done(self, answer: bytes) -> None:
        if answer and self._chance.random() >= self.loss:
            self._answer_at(asyncio.get_running_loop().time() + self.latency, answer)
        self._handle()
