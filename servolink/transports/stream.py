"""Transports over asyncio's own, of which serial and TCP differ only in how they connect; and TCP."""

from __future__ import annotations

import asyncio
import socket
from abc import abstractmethod
from collections.abc import Awaitable, Callable

from servolink.errors import OpenError
from servolink.transports.address import Address
from servolink.transports.lifecycle import BaseTransport

_DRAIN_LIMIT = 0.5  # seconds that close() gives sent bytes to leave
_DRAIN_STEP = 0.01


class StreamTransport(BaseTransport, asyncio.Protocol):
    """A transport over one of asyncio's own; a kind of stream implements `connect`."""

    def __init__(self, url: str) -> None:
        """Start unopened; errors call the transport `url`."""
        super().__init__(url)
        self._pipe: asyncio.Transport | None = None  # kept after the end
        self._gone = asyncio.Event()
        self._full = False  # whether the system left bytes in the pipe's buffer
        self.on_taken: Callable[[], object] | None = None
        """Called when the system has taken everything that `pass_on` left waiting."""
        self._sent = 0

    @abstractmethod
    async def connect(self) -> asyncio.Transport:
        """Connect with this object as the protocol and return asyncio's transport, as `create_connection` does.

        Raise OpenError, which says what to do; any other exception becomes one. Leave nothing open when it fails or
        is cancelled.
        """

    def data_received(self, data: bytes) -> None:
        """Pass `data` on (called by asyncio)."""
        self._deliver(data)

    def eof_received(self) -> None:
        """End at once, as half a connection is useless (called by asyncio)."""
        self._lose(ConnectionResetError("the other side closed the connection"))

    def connection_lost(self, exc: Exception | None) -> None:
        """End (called by asyncio, which closes the descriptor before any waiter runs on)."""
        self._gone.set()
        self._end(exc)

    def pause_writing(self) -> None:
        """Make sends wait: the system does not take everything at once (called by asyncio)."""
        self._full = True

    def resume_writing(self) -> None:
        """Release the waiting sends: the system has taken everything (called by asyncio)."""
        self._full = False
        self._wake_senders(taken=True)
        if self.on_taken is not None:
            self.on_taken()

    def pass_on(self, data: bytes) -> bool:
        """Give `data` to the system without a time limit; return whether it took all, or else calls `on_taken` later.

        For a relay, which has no say in how long a device may be busy. Raise ConnectionLost if it is not open.
        """
        if self._stage != "open" or self._pipe is None:
            raise self._lost()
        self._write(self._pipe, data)
        self._sent += len(data)
        return not self._full

    @property
    def baudrate(self) -> int:
        """The baud rate of a serial port; 0 for what has none."""
        return 0

    def set_baudrate(self, baudrate: int) -> bool:
        """Change the baud rate at once; return whether it has one now."""
        return False

    def pause_reading(self) -> None:
        """Leave what arrives to the system for now, which may slow the other side down."""
        if self._pipe is not None and not self._pipe.is_closing():
            self._pipe.pause_reading()

    def resume_reading(self) -> None:
        """Read again."""
        if self._pipe is not None and not self._pipe.is_closing():
            self._pipe.resume_reading()

    def _write(self, pipe: asyncio.Transport, data: bytes) -> None:
        """Give `data` to the system; `pipe` buffers the rest that it does not take, and calls `pause_writing`."""
        pipe.write(data)

    def _unsent(self) -> int:
        """Return the number of bytes that have not left yet."""
        return self._pipe.get_write_buffer_size() if self._pipe else 0

    async def _open(self) -> None:
        self._pipe = await self.connect()
        self._pipe.set_write_buffer_limits(high=0)  # so that resume_writing means: everything has been taken

    def _send(self, data: bytes) -> Awaitable[None] | None:
        if data and self._pipe is not None:  # pyserial-asyncio would spin on no data
            self._write(self._pipe, data)
            self._sent += len(data)
        return self._until_taken(asyncio.get_running_loop().create_future()) if self._full else None

    async def _close(self) -> None:
        if self._pipe is None:
            return
        loop = asyncio.get_running_loop()
        deadline = loop.time() + _DRAIN_LIMIT
        try:
            # A serial port does not say when its last byte has left.
            while self._stage == "closing" and self._unsent() and loop.time() < deadline:  # noqa: ASYNC110 - see above
                await asyncio.sleep(_DRAIN_STEP)
        finally:
            self._abort()
        await self._gone.wait()

    def _abort(self) -> None:
        # Once: a second abort of pyserial-asyncio's transport raises in a callback.
        if self._pipe is not None and not self._pipe.is_closing():
            try:
                self._pipe.abort()
            except RuntimeError:  # its event loop has ended, and asyncio cannot close anything without one
                self._release()
                self._gone.set()

    def _release(self) -> None:
        """Free the port without asyncio, once the event loop has ended."""
        if self._pipe is not None:  # abort() would leave this to the next turn of the loop
            self._pipe._call_connection_lost(None)  # type: ignore[attr-defined]  # noqa: SLF001

    def _taken(self) -> int:
        return self._sent - (self._pipe.get_write_buffer_size() if self._pipe else 0)


# By default a system takes megabytes ahead, then nothing for long: a slow line would look like a dead one.
_SEND_BUFFER = 65536


class TcpTransport(StreamTransport):
    """A TCP connection with keepalive; asyncio itself turns Nagle's delay off."""

    def __init__(self, url: str, host: str, port: int, *, timeout: float = 5.0) -> None:
        """Lead to `port` of `host`; opening takes at most `timeout` seconds."""
        super().__init__(url)
        self._host = host
        self._port = port
        self._timeout = timeout

    async def connect(self) -> asyncio.Transport:
        """Connect to the host; OpenError says what to check."""
        try:
            async with asyncio.timeout(self._timeout):
                pipe, _ = await asyncio.get_running_loop().create_connection(lambda: self, self._host, self._port)
        except (OSError, UnicodeError) as error:  # UnicodeError: the name cannot be a host's
            raise OpenError(f"{self.url}: {self._reason(error)}") from error
        connection = pipe.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        keep_alive(connection, idle=10, interval=5, count=3)
        return pipe

    def _reason(self, error: Exception) -> str:
        if isinstance(error, TimeoutError):
            return f"no answer within {self._timeout:g} s; check address, network and firewall, or give timeout=SECONDS"
        if isinstance(error, ConnectionRefusedError):
            return (
                f"nothing listens on port {self._port} of {self._host}; "
                "start the bridge or virtual board, or check the port"
            )
        if isinstance(error, socket.gaierror | UnicodeError):
            return f"there is no host '{self._host}'; check the name, or write its IP address"
        return f"cannot connect: {error}; check address and network"


def keep_alive(connection: socket.socket, *, idle: int, interval: int, count: int) -> None:
    """Make the system notice a peer that is silently gone, where that can be set after idle + interval * count s."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in {"TCP_KEEPIDLE": idle, "TCP_KEEPINTVL": interval, "TCP_KEEPCNT": count}.items():
        if hasattr(socket, name):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def from_address(address: Address) -> TcpTransport:
    """Make the transport for `tcp://host:port?timeout=SECONDS`."""
    if not address.host or address.path.strip("/"):
        raise address.refusal("must be written tcp://host:port")
    timeout = address.number("timeout", 5.0, 0.1, 600)
    address.refuse_unknown()
    return TcpTransport(address.url, address.host, address.port_number(), timeout=timeout)
