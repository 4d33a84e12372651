"""The contract of every transport; `lifecycle.BaseTransport` keeps it for most kinds."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

STALL_LIMIT = 2.0
"""Seconds in which the system takes no byte, after which a send fails and the connection is lost."""


class Receiver(Protocol):
    """The consumer of a transport's bytes; both methods are called on the event loop only."""

    def data(self, chunk: bytes, /) -> None:
        """Take the next bytes, in chunks of any size; must not raise."""

    def lost(self, error: Exception | None, /) -> None:
        """Handle the end of the transport; called once, with the cause, or None if the end was asked for."""


@runtime_checkable
class Transport(Protocol):
    """A byte pipe to a board, for one connection; each further connection needs a new one."""

    @property
    def url(self) -> str:
        """The address it leads to, as the user writes it."""
        ...

    async def open(self, receiver: Receiver) -> None:
        """Open the device; on return it is ready to send and receive.

        Raise OpenError, which says what to do, and leave nothing open, if that fails or if it was opened before,
        successfully or not.
        """

    async def send(self, data: bytes) -> None:
        """Send all of `data`; return when the system has taken it. Raise ConnectionLost if it is not open.

        The whole of `data` is taken before the first await: a cancelled send still goes out whole, and sends
        keep their order. Sending no bytes waits until everything sent before has been taken. If the system takes no
        byte for STALL_LIMIT seconds the connection is lost, as a frame may have been cut.
        """

    async def close(self) -> None:
        """Free the port within 1 s, whatever the device does; may be called in any state, and again.

        Bytes already sent get a moment to leave. Call `lost(None)` before returning, unless `lost` was called before.
        """
