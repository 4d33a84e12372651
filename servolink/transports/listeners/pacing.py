"""Pace of the messages of a token: a flood from many connections leaves the event loop time for a stop."""

from __future__ import annotations

import asyncio
from typing import Final

_MESSAGE: Final = 0.001
"""Seconds of work for a message."""
_BYTES: Final = 4 * 1024 * 1024
"""Bytes for a further second of work."""
_SHARE: Final = 0.02  # of the time, for the work of each connection, out of turn
_BURST: Final = 0.05  # seconds of work at once for each connection, out of turn
_STOPS: Final = 0.02  # seconds more for stops


class Pace:
    """Pace of a connection. Work beyond a small share takes turns with all connections of the same token."""

    def __init__(self, turn: asyncio.Lock) -> None:
        """Begin with a full share; connections with the same token have the same `turn`."""
        self._turn = turn
        self._now = asyncio.get_running_loop().time
        self._at = self._now()
        self._credit = _BURST

    async def keep(self, size: int, *, is_stop: bool = False) -> None:
        """Wait until a message of `size` bytes may be handled; not for a stop, except in a flood of stops."""
        work, now = _MESSAGE + size / _BYTES, self._now()
        self._credit = min(self._credit + (now - self._at) * _SHARE, _BURST)
        self._at = now
        if self._credit - work >= (-_STOPS if is_stop else 0):
            self._credit -= work
            return
        async with self._turn:
            await asyncio.sleep(work)
