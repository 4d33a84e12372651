"""Accepted connections, whose programs are handled with back-pressure in both directions."""

from __future__ import annotations

import asyncio
import logging
import socket
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Protocol

from servolink.errors import escape
from servolink.transports.listeners.accept import RareWarning, accepting, converse
from servolink.transports.listeners.strangers import Stranger, Strangers

HIGH, LOW = 128 * 1024, 32 * 1024
"""Unread bytes above which a handler is paused, and down to which a program must read to resume it."""
MOST_UNREAD = 8 * 1024 * 1024
"""Unread bytes above which a program is disconnected; more than all requests under way can bring."""
LONGEST_PAUSE = 10.0
"""Seconds without any reading, during a pause, after which a program is disconnected."""

_CHUNK = 4096  # bytes read at once, which are hundreds of requests
_LINGER = 0.5  # seconds for programs to read the last bytes before the end
_NOT_READ = "the program does not read its responses"
_logger = logging.getLogger(__name__)


class ProgramHandler(Protocol):
    """Receiver of the bytes of one program, made with a function that sends bytes back."""

    on_room: Callable[[], None] | None
    """Function to call when `is_full` ends."""

    @property
    def is_full(self) -> bool:
        """Whether reading from the program must pause."""
        ...

    @property
    def waiting(self) -> int:
        """Number of expected responses; while positive, the responses of a loop turn are sent together."""
        ...

    def receive(self, data: bytes, /) -> None:
        """Process the next bytes."""

    def pause(self) -> None:
        """Send as little as possible: the program does not read."""

    def resume(self) -> None:
        """Send as usual: the program reads again."""

    def leave(self) -> None:
        """End: the program is gone."""


class AcceptedConnection(asyncio.BufferedProtocol, ABC):
    """Connection of one program; a subclass finds the handler in `_begin`."""

    def __init__(self, *, high: int = HIGH, low: int = LOW) -> None:
        """Start unconnected; pause the handler while more than `high` bytes are unread, until only `low` are."""
        self.closed = asyncio.Event()
        """Set when the connection has ended."""
        self.who = "a program"
        """Name of the program in warnings."""
        self.admit: Callable[[], bool] = lambda: True
        """Function that admits the connection with the first bytes of a program; returns False without room."""
        self._loop = asyncio.get_running_loop()
        self._limits = high, low
        self._buffer = bytearray(_CHUNK)
        self._frames: list[bytes] = []
        self._pipe: asyncio.Transport | None = None
        self._handler: ProgramHandler | None = None
        self._must_read = True
        self._is_bounded = False
        self._written = 0
        self._timer: asyncio.TimerHandle | None = None  # while the program does not read

    @staticmethod
    @asynccontextmanager
    async def serving(
        listening: Sequence[socket.socket],
        make: Callable[[], AcceptedConnection],
        *,
        most: int | None = None,
        strangers: Strangers | None = None,
    ) -> AsyncIterator[None]:
        """Accept connections to these sockets within the context; `make` returns the object for each.

        At most `most` programs have a handler at a time, at all doors with such a limit. Connections without a handler
        are strangers, see `accepting`.
        """
        connections = set[AcceptedConnection]()
        warning = RareWarning()

        async def serve(accepted: socket.socket, stranger: Stranger) -> None:
            def admit() -> bool:
                if not (is_admitted := stranger.admit("frames", most)):
                    warning.log("%s was disconnected: %s programs are connected already", escape(connection.who), most)
                return is_admitted

            connection = make()
            connection.admit = admit
            connections.add(connection)
            try:
                await converse(connection, accepted)
            finally:
                connections.discard(connection)

        async with accepting(listening, serve, linger=_LINGER, strangers=strangers):
            try:
                yield
            finally:
                for connection in connections:
                    connection.end()

    def end(self) -> None:
        """Close the connection after the queued bytes."""
        if self._pipe is not None:
            self._flush()
            self._pipe.close()

    def abort(self, reason: str = "") -> None:
        """Close the connection at once; log the reason, unless empty."""
        if self._pipe is not None and not self._pipe.is_closing():
            if reason:
                _logger.warning("%s was disconnected: %s", escape(self.who), escape(reason))
            self._pipe.abort()

    def send(self, data: bytes) -> None:
        """Send bytes to the program; while responses are expected, together with others of the same loop turn."""
        if not self._frames and self._handler is not None and not self._handler.waiting:
            self._write(data)
            return
        if not self._frames:
            self._loop.call_soon(self._flush)
        self._frames.append(data)

    @abstractmethod
    def _begin(self, data: bytes) -> None:
        """Process bytes until the call of `_join`."""

    def _join(self, handler: ProgramHandler, *, must_read: bool = True, is_bounded: bool = False) -> None:
        """Pass all further bytes to `handler`.

        If the program `must_read`, disconnect it after `LONGEST_PAUSE` without reading, and when `MOST_UNREAD` bytes
        wait, unless the handler `is_bounded`: limits unread messages itself, each of which may be longer.
        """
        self.admit()
        self._handler = handler
        self._must_read = must_read
        self._is_bounded = is_bounded
        handler.on_room = self._resume

    def _receive(self, data: bytes) -> None:
        handler = self._handler
        if handler is None:
            self._begin(data)
            return
        handler.receive(data)
        if handler.is_full and self._pipe is not None:
            self._pipe.pause_reading()

    def _resume(self) -> None:
        if self._pipe is not None and not self._pipe.is_closing():
            self._pipe.resume_reading()

    def _flush(self) -> None:
        data = b"".join(self._frames)
        self._frames.clear()
        if data:
            self._write(data)

    def _write(self, data: bytes) -> None:
        if self._pipe is None or self._pipe.is_closing():
            return
        self._pipe.write(data)
        self._written += len(data)
        if self._must_read and not self._is_bounded and self._pipe.get_write_buffer_size() > MOST_UNREAD:
            self.abort(_NOT_READ)

    def _bytes_read(self) -> int:
        """Return the number of bytes accepted by the system for the program."""
        return self._written - (0 if self._pipe is None else self._pipe.get_write_buffer_size())

    def _look(self, read_before: int) -> None:
        """Disconnect the program if nothing was read since the last look."""
        if self._bytes_read() == read_before:
            self.abort(_NOT_READ)
        else:
            self._timer = self._loop.call_later(LONGEST_PAUSE, self._look, self._bytes_read())

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    # --- called by asyncio --------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin to handle the program's bytes."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - narrows the type
        self._pipe = transport
        transport.set_write_buffer_limits(*self._limits)

    def get_buffer(self, sizehint: int) -> bytearray:
        """Return the buffer for the next bytes."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Process the bytes in the buffer."""
        self._receive(bytes(self._buffer[:nbytes]))

    def pause_writing(self) -> None:
        """Pause the handler: too many bytes are unread."""
        if self._handler is not None:
            self._handler.pause()
            if self._must_read:
                self._timer = self._loop.call_later(LONGEST_PAUSE, self._look, self._bytes_read())

    def resume_writing(self) -> None:
        """Resume the handler: most bytes were read."""
        self._stop_timer()
        if self._handler is not None:
            self._handler.resume()

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell the handler that the program is gone."""
        self._stop_timer()
        self.closed.set()
        if self._handler is not None:
            self._handler.leave()
