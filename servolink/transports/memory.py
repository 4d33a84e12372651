"""Two ends in one process, joined as by a null-modem cable."""

from __future__ import annotations

import asyncio
from collections import deque
from weakref import WeakKeyDictionary

from servolink.errors import ConnectionLost, OpenError
from servolink.escaping import escape
from servolink.transports.address import Address
from servolink.transports.base import Receiver

_lines: WeakKeyDictionary[asyncio.AbstractEventLoop, dict[str, list[MemoryTransport]]] = WeakKeyDictionary()
"""The ends of each named line; an event loop has its own."""


class MemoryTransport:
    """One end; what is sent arrives at the other end in a later turn of the event loop, or once that is open."""

    def __init__(self, url: str = "memory://", name: str = "") -> None:
        """Be an end of the line `name`, which joins its first two openers; without a name, see `pair`."""
        self._url = url
        self._name = name
        self._peer: MemoryTransport | None = None
        self._coming: deque[bytes] = deque()
        self._going: deque[bytes] = deque()
        self._receiver: Receiver | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ended = ""  # why, once it has

    @classmethod
    def pair(cls) -> tuple[MemoryTransport, MemoryTransport]:
        """Make two joined ends."""
        one, other = cls(), cls()
        one._join(other)
        return one, other

    @property
    def url(self) -> str:
        """The address of the line."""
        return self._url

    async def open(self, receiver: Receiver) -> None:
        """Be ready; what the other end has sent so far arrives next."""
        if self._receiver is not None or self._ended:
            raise OpenError(f"{escape(self.url)}: a transport is opened once; make another")
        self._loop = asyncio.get_running_loop()
        if self._name:
            ends = _lines.setdefault(self._loop, {}).setdefault(self._name, [])
            if len(ends) == 2:
                raise OpenError(f"{escape(self.url)}: both ends are in use; close one, or take another name")
            if ends:
                self._join(ends[0])
            ends.append(self)
        self._receiver = receiver
        for _ in self._coming:
            self._loop.call_soon(self._deliver)

    async def send(self, data: bytes) -> None:
        """Send all of `data`, or raise ConnectionLost."""
        if self._ended or self._receiver is None:
            raise ConnectionLost(f"{escape(self.url)}: {self._ended or 'it is not open yet'}")
        if data:
            self._going.append(data)
            if self._peer is not None and self._peer._loop is not None:
                self._peer._loop.call_soon(self._peer._deliver)

    async def close(self) -> None:
        """End the line; the other end loses it once it has what was sent."""
        if not self._ended:
            self._end("it is closed", None)
            if self._peer is not None:
                self._peer._lose_soon("the other end was closed")

    def unplug(self) -> None:
        """Lose the line at both ends, as if the cable had been pulled."""
        self._lose_soon("it was unplugged")
        if self._peer is not None:
            self._peer._lose_soon("it was unplugged")

    def _join(self, peer: MemoryTransport) -> None:
        self._peer, peer._peer = peer, self
        self._coming, peer._coming = peer._going, self._going

    def _deliver(self) -> None:
        if self._receiver is None or self._ended:
            return
        try:
            self._receiver.data(self._coming.popleft())
        except Exception as error:  # noqa: BLE001 - whatever the bug is
            self._lose(f"the receiver failed: {escape(str(error))}")

    def _lose_soon(self, why: str) -> None:
        if self._loop is None:
            self._ended = self._ended or why
        else:
            self._loop.call_soon(self._lose, why)

    def _lose(self, why: str) -> None:
        if not self._ended:
            reason = f"the connection was lost: {why}"
            self._end(reason, ConnectionLost(f"{escape(self.url)}: {reason}"))

    def _end(self, why: str, error: ConnectionLost | None) -> None:
        self._ended = why
        if self._loop is not None:
            lines = _lines.get(self._loop, {})
            if self in lines.get(self._name, ()):
                del lines[self._name]  # from now on the name can be opened again
        if self._receiver is not None:
            self._receiver.lost(error)


def from_address(address: Address) -> MemoryTransport:
    """Make the transport for `memory://NAME`."""
    address.refuse_unknown()
    if not address.host or address.port or address.path.strip("/"):
        raise address.refusal("must name a line: memory://NAME")
    return MemoryTransport(address.url, address.host)
