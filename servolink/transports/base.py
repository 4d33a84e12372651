"""What every transport is."""

from __future__ import annotations

from typing import Protocol


class Receiver(Protocol):
    """Takes what a transport brings; both methods are called on the event loop only."""

    def data(self, chunk: bytes, /) -> None:
        """Take the next bytes, cut anyhow; never raises."""

    def lost(self, error: Exception | None, /) -> None:
        """Take note, exactly once, that the transport has ended: by `error`, or None for an end that was asked for."""


class Transport(Protocol):
    """A byte pipe to a board."""

    @property
    def url(self) -> str:
        """The address it leads to, as the user would write it."""

    async def open(self, receiver: Receiver) -> None:
        """Be ready to send and receive on return; OpenError says what to do, and leaves nothing open."""

    async def send(self, data: bytes) -> None:
        """Send all of `data`, or raise ConnectionLost.

        The whole of `data` is taken before the first await: a cancelled send still goes out whole, and sends
        keep their order. Returns when the system has taken the bytes, and fails when it has taken none for 2 s.
        """

    async def close(self) -> None:
        """Free the port within 1 s whatever the device does; may be called again; then `lost(None)` has been called."""
