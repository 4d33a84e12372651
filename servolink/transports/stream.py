"""A transport over one of asyncio's own transports: serial and TCP differ only in how they connect."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod

from servolink.errors import ConnectionLost, OpenError
from servolink.printable import printable
from servolink.transports.base import Receiver
from servolink.transports.stall import StallWatch

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
            raise OpenError(f"{printable(self.url)}: a transport is opened once; make another")
        self._receiver = receiver
        pipe = await self._connect()
        if self._gone.is_set():
            pipe.abort()
            raise OpenError(f"{printable(self.url)}: it was closed while being opened; try again")
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
            why = f"the connection was lost: {printable(str(self._cause))}"
        else:
            why = "it is closed" if self._closing else "it is not open yet"
        error = ConnectionLost(f"{printable(self.url)}: {why}")
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
