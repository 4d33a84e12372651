"""Contract of all transports, implemented for most kinds by `lifecycle.BaseTransport`."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

STALL_LIMIT = 2.0
"""Seconds without progress in sending, after which the send fails and the connection is lost."""


class Receiver(Protocol):
    """Consumer of the bytes of a transport; both methods are called on the event loop only."""

    def data(self, chunk: bytes, /) -> None:
        """Receive the next bytes, in chunks of any size; must not raise."""

    def lost(self, error: Exception | None, /) -> None:
        """Handle the end of the transport; called once, with the cause, or None after `close`."""


@runtime_checkable
class Transport(Protocol):
    """Byte pipe to a board, for one connection; each further connection needs a new transport."""

    @property
    def url(self) -> str:
        """Address of the transport, as written by the user."""
        ...

    async def open(self, receiver: Receiver) -> None:
        """Open the device; on return the transport is ready to send and receive.

        Raise OpenError with the remedy, and leave nothing open, if opening fails, or if `open` was called before,
        successfully or not.
        """

    async def send(self, data: bytes) -> None:
        """Send all of `data`; return when the system has accepted all bytes.

        All of `data` is queued before the first await: a cancelled send still goes out whole, and sends keep their
        order. Sending no bytes waits until the system has accepted all earlier bytes.

        Raises:
            ConnectionLost: The transport is not open, or the system accepted no byte for STALL_LIMIT seconds: a frame
                may be cut, so the connection is lost.

        """

    async def close(self) -> None:
        """Free the port within 1 s, even if the device hangs; may be called in any state, and again.

        Sent bytes get a moment to leave. `lost(None)` is called before the return, unless `lost` was called before.
        """
