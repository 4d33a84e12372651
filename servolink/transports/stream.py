"""Base of transports over asyncio transports, for serial ports and TCP; and TCP."""

from __future__ import annotations

import asyncio
import socket
from abc import abstractmethod
from collections.abc import Awaitable, Callable

from servolink.errors import OpenError
from servolink.support import reason
from servolink.transports.address import Address
from servolink.transports.lifecycle import BaseTransport

_DRAIN_LIMIT = 0.5  # seconds for sent bytes to leave in close()
_DRAIN_STEP = 0.01


class StreamTransport(BaseTransport, asyncio.Protocol):
    """Transport over an asyncio transport; each kind of stream implements `connect`."""

    is_stream = True
    """Whether frames may be joined in one write."""

    def __init__(self, url: str) -> None:
        """Start unopened; `url` names the transport in errors."""
        super().__init__(url)
        self._pipe: asyncio.Transport | None = None  # kept after the end
        self._disconnected = asyncio.Event()
        self._full = False  # whether bytes wait in the buffer of the pipe
        self.on_accepted: Callable[[], object] | None = None
        """Callback when the system has accepted all bytes of `pass_on`."""
        self._sent = 0

    @abstractmethod
    async def connect(self) -> asyncio.Transport:
        """Connect with this object as the protocol and return the asyncio transport, as by `create_connection`.

        Raise OpenError with the remedy; any other exception becomes an OpenError. Leave nothing open after a failure
        or cancellation.
        """

    def data_received(self, data: bytes) -> None:
        """Pass `data` to the receiver (called by asyncio)."""
        self._deliver(data)

    def eof_received(self) -> None:
        """End the connection: half a connection is useless (called by asyncio)."""
        self._lose(ConnectionResetError("the other side closed the connection"))

    def connection_lost(self, exc: Exception | None) -> None:
        """End the connection (called by asyncio; waiters continue after the descriptor was closed)."""
        self._disconnected.set()
        self._end(exc)

    def pause_writing(self) -> None:
        """Make sends wait: the buffer of the system is full (called by asyncio)."""
        self._full = True

    def resume_writing(self) -> None:
        """Release the waiting sends: the system has accepted all bytes (called by asyncio)."""
        self._full = False
        self._wake_senders(accepted=True)
        if self.on_accepted is not None:
            self.on_accepted()

    def pass_on(self, data: bytes) -> bool:
        """Send `data` without a time limit. Return whether the system accepted all; otherwise call `on_accepted` later.

        For relays, which cannot know how long a device may be busy. Raise ConnectionLost for a closed transport.
        """
        if self._stage != "open" or self._pipe is None:
            raise self._lost()
        self._write(self._pipe, data)
        self._sent += len(data)
        return not self._full

    @property
    def baudrate(self) -> int:
        """Baud rate of a serial port; 0 for other streams."""
        return 0

    def set_baudrate(self, baudrate: int) -> bool:
        """Change the baud rate immediately; return whether the stream supports `baudrate`."""
        return False

    def pause_reading(self) -> None:
        """Stop reading: bytes wait in buffers of the system, and may slow the sender down."""
        if self._pipe is not None and not self._pipe.is_closing():
            self._pipe.pause_reading()

    def resume_reading(self) -> None:
        """Continue reading after `pause_reading`."""
        if self._pipe is not None and not self._pipe.is_closing():
            self._pipe.resume_reading()

    def _write(self, pipe: asyncio.Transport, data: bytes) -> None:
        """Pass `data` to the system; `pipe` buffers the rest and calls `pause_writing`."""
        pipe.write(data)

    def _unsent(self) -> int:
        """Return the number of bytes still waiting to be sent."""
        return self._pipe.get_write_buffer_size() if self._pipe else 0

    async def _open(self) -> None:
        self._pipe = await self.connect()
        self._pipe.set_write_buffer_limits(high=0)  # so that resume_writing means: the system has accepted all bytes

    def _send(self, data: bytes) -> Awaitable[None] | None:
        if data and self._pipe is not None:  # without data, pyserial-asyncio would spin
            self._write(self._pipe, data)
            self._sent += len(data)
        return self._until_accepted(asyncio.get_running_loop().create_future()) if self._full else None

    async def _close(self) -> None:
        if self._pipe is None:
            return
        loop = asyncio.get_running_loop()
        deadline = loop.time() + _DRAIN_LIMIT
        try:
            # A serial port does not report the departure of the last byte.
            while self._stage == "closing" and self._unsent() and loop.time() < deadline:  # noqa: ASYNC110 - see above
                await asyncio.sleep(_DRAIN_STEP)
        finally:
            self._abort()
        await self._disconnected.wait()

    def _abort(self) -> None:
        # Once: a second abort of pyserial-asyncio's transport raises in a callback.
        if self._pipe is not None and not self._pipe.is_closing():
            try:
                self._pipe.abort()
            except RuntimeError:  # asyncio cannot close a transport after the end of the event loop
                self._release()
                self._disconnected.set()

    def _release(self) -> None:
        """Free the port without asyncio, once the event loop has ended."""
        if self._pipe is not None:  # abort() would close the descriptor in the next turn of the loop
            self._pipe._call_connection_lost(None)  # type: ignore[attr-defined]  # noqa: SLF001

    def _accepted(self) -> int:
        return self._sent - (self._pipe.get_write_buffer_size() if self._pipe else 0)


# By default a system accepts megabytes, then nothing for long: a slow line would look like a dead line.
_SEND_BUFFER = 65536


class TcpTransport(StreamTransport):
    """TCP connection with keepalive; asyncio turns Nagle's delay off."""

    def __init__(self, url: str, host: str, port: int, *, timeout: float = 5.0) -> None:
        """Use `port` of `host`; opening takes at most `timeout` seconds."""
        super().__init__(url)
        self._host = host
        self._port = port
        self._timeout = timeout

    async def connect(self) -> asyncio.Transport:
        """Connect to the host. Raise OpenError with the things to check."""
        try:
            async with asyncio.timeout(self._timeout):
                pipe, _ = await asyncio.get_running_loop().create_connection(lambda: self, self._host, self._port)
        except (OSError, UnicodeError) as error:  # UnicodeError: the name is not a valid host name
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
        return f"cannot connect: {reason(error)}; check address and network"


def keep_alive(connection: socket.socket, *, idle: int, interval: int, count: int) -> None:
    """Detect a silently lost peer after idle + interval * count seconds, on systems with this setting."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in {"TCP_KEEPIDLE": idle, "TCP_KEEPINTVL": interval, "TCP_KEEPCNT": count}.items():
        if hasattr(socket, name):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def from_address(address: Address) -> TcpTransport:
    """Make the transport for `tcp://host:port?timeout=SECONDS`, or `socket://`, its name in other programs."""
    if not address.host or address.path.strip("/"):
        raise address.refusal("must be written tcp://host:port")
    timeout = address.number("timeout", 5.0, 0.1, 600)
    address.refuse_unknown()
    return TcpTransport(address.url, address.host, address.port_number(), timeout=timeout)
