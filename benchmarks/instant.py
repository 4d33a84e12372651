"""A board without a line: it answers in the next turn of the event loop, from a table, at hardly any cost."""

from __future__ import annotations

import asyncio

from benchmarks.answers import answers
from servolink.protocol.frame import OVERHEAD
from servolink.transports.lifecycle import BaseTransport


class InstantTransport(BaseTransport):
    """A connection to it; `receive` brings bytes that nobody asked for."""

    def __init__(self) -> None:
        """Lead to a board of its own."""
        super().__init__("instant://")
        self._answers = answers()

    def receive(self, data: bytes) -> None:
        """Receive `data` now."""
        self._deliver(data)

    async def _open(self) -> None:
        self._soon = asyncio.get_running_loop().call_soon

    def _send(self, data: bytes) -> None:
        for packet_id, _ in requests(data):
            if packet_id in self._answers:
                self._soon(self._deliver, self._answers[packet_id])

    async def _close(self) -> None:
        """Nothing is open."""

    def _abort(self) -> None:
        """Nothing is open."""


def requests(frames: bytes) -> list[tuple[int, int]]:
    """Return packet id and size of each of several whole frames."""
    found, at = [], 0
    while at < len(frames):
        size = OVERHEAD + (frames[at + 6] | frames[at + 7] << 8)
        found.append((frames[at + 4] | frames[at + 5] << 8, size))
        at += size
    return found
