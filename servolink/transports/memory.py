"""Transport between two ends in one process, joined as by a null-modem cable."""

from __future__ import annotations

import asyncio
from collections import deque
from weakref import WeakKeyDictionary

from servolink.errors import OpenError, Reason
from servolink.transports.address import Address
from servolink.transports.lifecycle import BaseTransport

_lines: WeakKeyDictionary[asyncio.AbstractEventLoop, dict[str, list[MemoryTransport]]] = WeakKeyDictionary()
"""Open ends of each named line, separate for each event loop."""


class MemoryTransport(BaseTransport):
    """End of a line; bytes arrive in a later turn of the event loop, or as soon as the other end is open."""

    def __init__(self, url: str = "memory://", name: str = "") -> None:
        """Prepare an end of the line `name`, which joins the first two opened ends; without a name, see `pair`."""
        super().__init__(url)
        self._name = name
        self._peer: MemoryTransport | None = None
        self._coming: deque[bytes] = deque()
        self._going: deque[bytes] = deque()
        self._loop: asyncio.AbstractEventLoop | None = None

    @classmethod
    def pair(cls) -> tuple[MemoryTransport, MemoryTransport]:
        """Return two joined ends of a line without a name."""
        one, other = cls(), cls()
        one._join(other)
        return one, other

    def unplug(self) -> None:
        """Lose the line at both ends, as if the cable had been pulled."""
        self._lose_soon("it was unplugged")
        if self._peer is not None:
            self._peer._lose_soon("it was unplugged")

    async def _open(self) -> None:
        loop = asyncio.get_running_loop()
        if self._name:
            ends = _lines.setdefault(loop, {}).setdefault(self._name, [])
            if len(ends) == 2:
                raise OpenError(
                    f"{self.url}: both ends are in use; close one, or use another name", reason=Reason.IN_USE
                )
            if ends:
                self._join(ends[0])
            ends.append(self)
        self._loop = loop
        for _ in self._coming:  # sent by the other end before the opening
            loop.call_soon(self._receive)

    def _send(self, data: bytes) -> None:
        if data:
            self._going.append(data)
            if self._peer is not None and self._peer._loop is not None:
                self._peer._loop.call_soon(self._peer._receive)

    async def _close(self) -> None:
        if self._peer is not None:  # the other end receives the sent bytes first
            self._peer._lose_soon("the other end was closed")

    def _abort(self) -> None:
        lines = _lines.get(self._loop, {}) if self._loop is not None else {}
        if self in lines.get(self._name, ()):
            del lines[self._name]  # the name can be opened again

    def _join(self, peer: MemoryTransport) -> None:
        self._peer, peer._peer = peer, self
        self._coming, peer._coming = peer._going, self._going

    def _receive(self) -> None:
        if self._stage != "ended":
            self._deliver(self._coming.popleft())

    def _lose_soon(self, why: str) -> None:
        if self._loop is None:
            self._lose(ConnectionError(why))
        else:
            self._loop.call_soon(self._lose, ConnectionError(why))


def from_address(address: Address) -> MemoryTransport:
    """Make the transport for `memory://NAME`."""
    address.refuse_unknown()
    if not address.host or address.port or address.path.strip("/"):
        raise address.refusal("must name a line: memory://NAME")
    return MemoryTransport(address.url, address.host)
