"""A cable to a virtual board that is pulled after so many bytes."""

from __future__ import annotations

from servolink.errors import ConnectionLost
from servolink.transports import WrappedTransport
from servolink.virtual import VirtualBoard, VirtualTransport

URL = "virtual://bench"


class Cable(WrappedTransport):
    """Carries the bytes before the one at which it is pulled, counted in each direction."""

    def __init__(self, board: VirtualBoard, *, sent: int | None = None, received: int | None = None) -> None:
        """Lead to `board`; be pulled after so many bytes `sent` by the host or `received` by it."""
        self._line = VirtualTransport(board, URL)
        super().__init__(self._line)
        self._most_sent, self._most_received = sent, received
        self.sent = self.received = 0

    async def send(self, data: bytes) -> None:
        """Send `data` as far as it goes."""
        if self._stage != "open":
            raise self._lost()
        passed = data if self._most_sent is None else data[: self._most_sent - self.sent]
        self.sent += len(passed)
        await self._inner.send(passed)
        if self.sent == self._most_sent:
            self._line.unplug()
            raise ConnectionLost("the cable was pulled")

    def data(self, chunk: bytes, /) -> None:
        """Deliver `chunk` as far as it comes."""
        passed = chunk if self._most_received is None else chunk[: self._most_received - self.received]
        self.received += len(passed)
        self._deliver(passed)
        if self.received == self._most_received:
            self._line.unplug()
