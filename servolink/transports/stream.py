"""A transport over one of asyncio's own transports: serial and TCP differ only in how they connect."""

from __future__ import annotations

import asyncio
import socket
from abc import ABC, abstractmethod

from servolink.errors import ConnectionLost, OpenError
from servolink.escaping import escape
from servolink.transports.address import Address
from servolink.transports.base import Receiver
from servolink.transports.lifecycle import StallWatch

_DRAIN_LIMIT = 0.5  # seconds that close() gives what was sent to leave
_DRAIN_STEP = 0.01


class StreamTransport(asyncio.Protocol, ABC):
    """Sends, receives, notices the end and closes; a kind of stream adds `_connect`."""

    def __init__(self, url: str) -> None:
        """Lead to `url`, which is shown in errors."""
        self._url = url
        self._receiver: Receiver | None = None
        self._pipe: asyncio.Transport | None = None  # set once it is open, and kept after the end
        self._gone = asyncio.Event()
        self._closing = False
        self._cause: Exception | None = None
        self._senders: list[asyncio.Future[bool]] = []  # told whether the system took their bytes
        self._full = False
        self._sent = 0
        self._watch = StallWatch(lambda: self._full, self._taken, self._end)

    @property
    def url(self) -> str:
        """The address it leads to."""
        return self._url

    @abstractmethod
    async def _connect(self) -> asyncio.Transport:
        """Connect with this object as the protocol; OpenError says what to do."""

    def _write(self, pipe: asyncio.Transport, data: bytes) -> None:
        """Give `data` to the system; `pipe` keeps what it does not take, and calls `pause_writing`."""
        pipe.write(data)

    def _unsent(self) -> int:
        """Bytes that have not left yet."""
        return self._pipe.get_write_buffer_size() if self._pipe else 0

    async def open(self, receiver: Receiver) -> None:
        """Connect; OpenError says what to do."""
        if self._receiver is not None or self._closing:
            raise OpenError(f"{escape(self.url)}: a transport is opened once; make another")
        self._receiver = receiver
        pipe = await self._connect()
        if self._gone.is_set():
            pipe.abort()
            raise OpenError(f"{escape(self.url)}: it was closed while being opened; try again")
        pipe.set_write_buffer_limits(high=0)  # so that resume_writing means: all has been taken
        self._pipe = pipe

    async def send(self, data: bytes) -> None:
        """Send all of `data`, or raise ConnectionLost."""
        if self._pipe is None or self._closing or self._cause is not None or self._gone.is_set():
            raise self._lost()
        if data:  # pyserial-asyncio would spin on none
            self._write(self._pipe, data)
            self._sent += len(data)
        if self._full:
            taken = asyncio.get_running_loop().create_future()
            self._senders.append(taken)
            self._watch.start()
            if not await taken:
                raise self._lost()

    async def close(self) -> None:
        """Free the port within 1 s; what was sent gets half of it to leave."""
        self._closing = True
        if self._pipe is None:
            self._gone.set()
            return
        loop = asyncio.get_running_loop()
        deadline = loop.time() + _DRAIN_LIMIT
        try:
            while self._cause is None and not self._gone.is_set() and self._unsent() and loop.time() < deadline:  # noqa: ASYNC110
                await asyncio.sleep(_DRAIN_STEP)  # a serial port does not tell when its last byte has left
        finally:
            self._abort()
        await self._gone.wait()

    def data_received(self, data: bytes) -> None:
        """Pass `data` on; a receiver that fails ends the connection instead of losing bytes unseen."""
        if self._receiver is None or self._cause is not None:
            return
        try:
            self._receiver.data(data)
        except Exception as error:  # noqa: BLE001 - whatever the bug is
            self._end(error)

    def eof_received(self) -> None:
        """End at once: half a connection is no use."""
        self._end(ConnectionResetError("the other side closed the connection"))

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell the receiver and whoever waits; asyncio closes the descriptor before any waiter runs on."""
        self._gone.set()
        if self._pipe is None or self._receiver is None:
            return  # open did not succeed, and says so itself
        self._cause = self._cause or exc
        self._wake_senders(taken=False)
        self._watch.stop()
        self._receiver.lost(None if self._cause is None else self._lost())

    def pause_writing(self) -> None:
        """The system does not take all at once."""
        self._full = True

    def resume_writing(self) -> None:
        """The system has taken all."""
        self._full = False
        self._wake_senders(taken=True)

    def _lost(self) -> ConnectionLost:
        if self._cause is not None:
            why = f"the connection was lost: {escape(str(self._cause))}"
        else:
            why = "it is closed" if self._closing else "it is not open yet"
        error = ConnectionLost(f"{escape(self.url)}: {why}")
        error.__cause__ = self._cause
        return error

    def _end(self, cause: Exception) -> None:
        """Lose the connection because of `cause`, unless it has ended already."""
        if self._cause is None:
            self._cause = cause
            self._abort()

    def _abort(self) -> None:
        # Once: a second abort of pyserial-asyncio's transport raises in a callback.
        if self._pipe is not None and not self._pipe.is_closing():
            self._pipe.abort()

    def _wake_senders(self, *, taken: bool) -> None:
        senders, self._senders = self._senders, []
        for sender in senders:
            if not sender.done():
                sender.set_result(taken)

    def _taken(self) -> int:
        return self._sent - (self._pipe.get_write_buffer_size() if self._pipe else 0)


# Where the system lets us choose: a peer that is silently gone is noticed after 10 + 3 * 5 s.
_KEEPALIVE = {"TCP_KEEPIDLE": 10, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 3}

# A system left alone takes megabytes ahead, then nothing for long: a slow line would look like a dead one.
_SEND_BUFFER = 65536


class TcpTransport(StreamTransport):
    """A TCP connection with keepalive; asyncio itself turns Nagle's delay off."""

    def __init__(self, url: str, host: str, port: int, *, timeout: float = 5.0) -> None:
        """Lead to `port` of `host`; `timeout` is in seconds and bounds the opening."""
        super().__init__(url)
        self._host = host
        self._port = port
        self._timeout = timeout

    async def _connect(self) -> asyncio.Transport:
        try:
            async with asyncio.timeout(self._timeout):
                pipe, _ = await asyncio.get_running_loop().create_connection(lambda: self, self._host, self._port)
        except (OSError, UnicodeError) as error:  # UnicodeError: the name can be no host's
            raise OpenError(f"{escape(self.url)}: {self._reason(error)}") from error
        self._tune(pipe.get_extra_info("socket"))
        return pipe

    def _reason(self, error: Exception) -> str:
        host = escape(self._host)
        if isinstance(error, TimeoutError):
            return f"no answer within {self._timeout:g} s; check address, network and firewall, or give timeout=SECONDS"
        if isinstance(error, ConnectionRefusedError):
            return (
                f"nothing listens on port {self._port} of {host}; start the bridge or virtual board, or check the port"
            )
        if isinstance(error, socket.gaierror | UnicodeError):
            return f"there is no host '{host}'; check the name, or write its IP address"
        return f"cannot connect: {escape(str(error))}; check address and network"

    @staticmethod
    def _tune(connection: socket.socket) -> None:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        for name, value in _KEEPALIVE.items():
            if hasattr(socket, name):
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def from_address(address: Address) -> TcpTransport:
    """Make the transport for `tcp://host:port?timeout=SECONDS`."""
    if not address.host or address.path.strip("/"):
        raise address.refusal("must be written tcp://host:port")
    timeout = address.number("timeout", 5.0, 0.1, 600)
    address.refuse_unknown()
    return TcpTransport(address.url, address.host, address.port_number(), timeout=timeout)
