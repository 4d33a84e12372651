"""A line on which one thing at a time goes wrong, as asked."""

from __future__ import annotations

import asyncio

from servolink.transports.base import Transport
from servolink.transports.wrapper import WrappedTransport


class FaultyLine(WrappedTransport):
    """A line that is perfect until it is told to damage or to delay the next reply, or is pulled out."""

    def __init__(self, inner: Transport) -> None:
        """Wrap `inner`."""
        super().__init__(inner)
        self.damaged = 0
        """Replies of which a byte was changed."""
        self.delayed = 0
        """Replies that were held back."""
        self._damage = False
        self._delay = 0.0
        self._held: list[bytes] = []
        self._timer: asyncio.TimerHandle | None = None

    def damage_next(self) -> None:
        """Change one bit in the middle of what comes next."""
        self._damage = True

    def delay_next(self, seconds: float) -> None:
        """Hold back what comes next; whatever comes meanwhile stays behind it, as on any line."""
        self._delay = seconds

    def pull(self) -> None:
        """Be pulled out now."""
        self._break("the cable was pulled")

    def data(self, chunk: bytes, /) -> None:
        """Pass on what comes, or what becomes of it."""
        if self._damage:
            self._damage = False
            self.damaged += 1
            middle = len(chunk) // 2
            chunk = chunk[:middle] + bytes([chunk[middle] ^ 0x10]) + chunk[middle + 1 :]
        if self._delay:
            self.delayed += 1
            self._timer = asyncio.get_running_loop().call_later(self._delay, self._release)
            self._delay = 0.0
        if self._timer is None:
            self._deliver(chunk)
        else:
            self._held.append(chunk)

    async def close(self) -> None:
        """Close the line; what is held back is lost."""
        if self._timer is not None:
            self._timer.cancel()
        await super().close()

    def _release(self) -> None:
        self._timer = None
        held, self._held = self._held, []
        for chunk in held:
            self._deliver(chunk)
