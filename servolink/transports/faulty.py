"""A transport made worse, for tests and demonstrations."""

from __future__ import annotations

import asyncio
from collections import deque

from servolink.errors import ConnectionLost
from servolink.transports.base import Transport
from servolink.transports.faults import Faults, LineFaults
from servolink.transports.wrapper import WrappedTransport

_UNPLUGGED = "it was unplugged by fault injection"


class FaultyTransport(WrappedTransport):
    """Applies faults to what is sent, to what is received, or to both; a delayed chunk delays those behind it."""

    def __init__(
        self, inner: Transport, faults: Faults, *, seed: int = 0, sent: bool = True, received: bool = True
    ) -> None:
        """Wrap `inner`; each direction draws its own faults from `seed`."""
        super().__init__(inner)
        self._down = LineFaults(faults if sent else Faults(), f"sent {seed}")
        self._up = LineFaults(faults if received else Faults(), f"received {seed}")
        self._late_down: deque[tuple[float, bytes]] = deque()
        self._late_up: deque[tuple[float, bytes]] = deque()
        self._sending: asyncio.Task[None] | None = None
        self._timer: asyncio.TimerHandle | None = None

    async def send(self, data: bytes) -> None:
        """Send what the faults leave of `data`; what is delayed counts as sent."""
        self._check_open()
        now = asyncio.get_running_loop().time()
        pieces = self._down.apply(data, now)
        if self._late_down or any(at > now for at, _ in pieces):
            self._late_down += pieces
            if pieces and (self._sending is None or self._sending.done()):
                self._sending = asyncio.ensure_future(self._send_late())
        elif pieces or not data:
            await self._inner.send(b"".join(piece for _, piece in pieces))
        if self._down.unplugged:
            self._break(_UNPLUGGED)
            self._check_open()

    async def close(self) -> None:
        """Close the wrapped transport; what is still delayed is lost."""
        self._forget_late()
        await super().close()

    def data(self, chunk: bytes, /) -> None:
        """Pass on what the faults leave of `chunk`."""
        now = asyncio.get_running_loop().time()
        for at, piece in self._up.apply(chunk, now):
            if self._late_up or at > now:
                self._late_up.append((at, piece))
            else:
                self._deliver(piece)
        self._arm()
        if self._up.unplugged:
            self._break(_UNPLUGGED)

    def _end(self, error: Exception | None) -> None:
        self._forget_late()
        super()._end(error)

    async def _send_late(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            while self._late_down:
                at, piece = self._late_down[0]  # stays in front meanwhile, so that nothing overtakes it
                await asyncio.sleep(at - loop.time())
                await self._inner.send(piece)
                self._late_down.popleft()
        except ConnectionLost:
            self._late_down.clear()  # the wrapped transport says so itself

    def _arm(self) -> None:
        if self._late_up and self._timer is None:
            self._timer = asyncio.get_running_loop().call_at(self._late_up[0][0], self._release)

    def _release(self) -> None:
        self._timer = None
        now = max(self._late_up[0][0], asyncio.get_running_loop().time())  # a timer may come a rounding error early
        while self._late_up and self._late_up[0][0] <= now:
            self._deliver(self._late_up.popleft()[1])
        self._arm()

    def _forget_late(self) -> None:
        if self._sending is not None:
            self._sending.cancel()
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None
        self._late_down.clear()
        self._late_up.clear()
