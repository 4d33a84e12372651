"""What every transport is."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

STALL_LIMIT = 2.0
"""Seconds without the system taking a byte after which a send fails and the connection is lost."""


class Receiver(Protocol):
    """Takes what a transport brings; both methods are called on the event loop only."""

    def data(self, chunk: bytes, /) -> None:
        """Take the next bytes, cut anyhow; never raises."""

    def lost(self, error: Exception | None, /) -> None:
        """Take note, exactly once, that the transport has ended: by `error`, or None for an end that was asked for."""


@runtime_checkable
class Transport(Protocol):
    """A byte pipe to a board, for one connection: for the next one make another."""

    @property
    def url(self) -> str:
        """The address it leads to, as the user would write it."""
        ...

    async def open(self, receiver: Receiver) -> None:
        """Be ready to send and receive on return; OpenError says what to do, and leaves nothing open.

        Opening again is an OpenError, also after an open that failed.
        """

    async def send(self, data: bytes) -> None:
        """Send all of `data`, or raise ConnectionLost, also when it is not open.

        The whole of `data` is taken before the first await: a cancelled send still goes out whole, and sends
        keep their order. Returns when the system has taken the bytes; for no bytes, when it has taken all that was
        sent before. When it has taken none for STALL_LIMIT the connection is lost, as a frame was cut off.
        """

    async def close(self) -> None:
        """Free the port within 1 s whatever the device does; may be called again; then `lost(None)` has been called.

        What was sent gets a moment to leave. If the connection was lost before, `lost` is not called again.
        """
