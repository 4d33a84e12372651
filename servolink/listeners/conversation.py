"""Conversations with programs, whether they come by a socket or a terminal, held back in both directions."""

from __future__ import annotations

import asyncio
import logging
import socket
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Any, Protocol

from servolink.escaping import escape
from servolink.listeners.accept import RareWarning, accepting

HIGH, LOW = 128 * 1024, 32 * 1024
"""Bytes that a program has not read, at which its conversation pauses, and at which it is resumed."""
MOST_UNREAD = 8 * 1024 * 1024
"""Bytes at which it is disconnected at once; a terminal drops what follows. What is under way brings less."""
LONGEST_PAUSE = 10.0
"""Seconds in which it reads nothing, after which it is disconnected."""

_CHUNK = 4096  # bytes that are read at once: hundreds of requests, of which a conversation takes no more for a while
_LINGER = 0.5  # seconds for programs to read what they were sent before the end
_NOT_READ = "it does not read what it asked for"
_logger = logging.getLogger(__name__)


class Conversation(Protocol):
    """Takes what one program sends; it was given a function that sends to the program."""

    on_room: Callable[[], None] | None
    """Called when more can be taken after `is_full`."""

    @property
    def is_full(self) -> bool:
        """Whether the program must not be read for now."""
        ...

    @property
    def waiting(self) -> int:
        """Number of responses to come; those of one turn of the event loop are then sent together."""
        ...

    def receive(self, data: bytes, /) -> None:
        """Take the next bytes."""

    def pause(self) -> None:
        """Send as little as possible: the program does not read."""

    def resume(self) -> None:
        """Send as usual: the program reads again."""

    def leave(self) -> None:
        """End: the program is gone."""


class AcceptedConnection(asyncio.BufferedProtocol, ABC):
    """Connection of one program; a kind of door says in `_begin` with which bytes its conversation begins."""

    def __init__(self, *, high: int = HIGH, low: int = LOW) -> None:
        """Start unconnected; pause the conversation while more than `high` bytes are unread, until only `low` are."""
        self.gone = asyncio.Event()
        """Set when the connection has ended."""
        self.who = "a program"
        """Name of the program in warnings."""
        self._loop = asyncio.get_running_loop()
        self._limits = high, low
        self._buffer = bytearray(_CHUNK)
        self._frames: list[bytes] = []
        self._pipe: asyncio.Transport | None = None
        self._conversation: Conversation | None = None
        self._must_read = True
        self._written = 0
        self._timer: asyncio.TimerHandle | None = None  # while the program does not read

    @property
    def has_begun(self) -> bool:
        """Whether the program has begun as it should."""
        return self._conversation is not None

    def end(self) -> None:
        """Close the connection; what was sent may still be read for a moment."""
        if self._pipe is not None:
            self._flush()
            self._pipe.close()

    def abort(self, reason: str = "") -> None:
        """Close the connection at once; log the reason if there is one."""
        if self._pipe is not None and not self._pipe.is_closing():
            if reason:
                _logger.warning("%s was disconnected: %s", escape(self.who), escape(reason))
            self._pipe.abort()

    def send(self, data: bytes) -> None:
        """Send bytes to the program, together with all others of this turn of the loop if it waits for more."""
        if not self._frames and self._conversation is not None and not self._conversation.waiting:
            self._write(data)
            return
        if not self._frames:
            self._loop.call_soon(self._flush)
        self._frames.append(data)

    @abstractmethod
    def _begin(self, data: bytes) -> None:
        """Take the first bytes, up to the call of `_join`."""

    def _join(self, conversation: Conversation, *, must_read: bool = True) -> None:
        """Carry everything from now on to this conversation.

        Disconnect a program that does not read, if it `must_read`; otherwise the conversation bounds what waits for it.
        """
        self._conversation = conversation
        self._must_read = must_read
        conversation.on_room = self._resume

    def _receive(self, data: bytes) -> None:
        conversation = self._conversation
        if conversation is None:
            self._begin(data)
            return
        conversation.receive(data)
        if conversation.is_full and self._pipe is not None:
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
        if self._must_read and self._pipe.get_write_buffer_size() > MOST_UNREAD:
            self.abort(_NOT_READ)

    def _read_so_far(self) -> int:
        """Return how many bytes the system has taken for the program."""
        return self._written - (0 if self._pipe is None else self._pipe.get_write_buffer_size())

    def _look(self, read_before: int) -> None:
        """Disconnect a program that has read nothing since the last look."""
        if self._read_so_far() == read_before:
            self.abort(_NOT_READ)
        else:
            self._timer = self._loop.call_later(LONGEST_PAUSE, self._look, self._read_so_far())

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    # --- called by asyncio --------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - narrows the type
        self._pipe = transport
        transport.set_write_buffer_limits(*self._limits)

    def get_buffer(self, sizehint: int) -> bytearray:
        """Return where to put the next bytes."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Take the next bytes."""
        self._receive(bytes(self._buffer[:nbytes]))

    def pause_writing(self) -> None:
        """Ask for nothing more until the program reads what it has."""
        if self._conversation is not None:
            self._conversation.pause()
            if self._must_read:
                self._timer = self._loop.call_later(LONGEST_PAUSE, self._look, self._read_so_far())

    def resume_writing(self) -> None:
        """Ask again."""
        self._stop_timer()
        if self._conversation is not None:
            self._conversation.resume()

    def connection_lost(self, exc: Exception | None) -> None:
        """End the conversation."""
        self._stop_timer()
        self.gone.set()
        if self._conversation is not None:
            self._conversation.leave()


@asynccontextmanager
async def serve_connections(
    listening: Sequence[socket.socket], make: Callable[[], AcceptedConnection], *, most: int | None = None
) -> AsyncIterator[None]:
    """Make an object for each connection to these sockets within this context; for at most `most` at once.

    One more takes the place of the one that has been connected longest without having begun, or is closed.
    """
    connections = dict[AcceptedConnection, asyncio.Task[Any] | None]()  # the oldest first
    warning = RareWarning()

    async def serve(accepted: socket.socket) -> None:
        if most is not None and len(connections) >= most:
            warning.log("%d connections are open: there is no room for more", most)
            if not _drop_silent(connections):
                accepted.close()
                return
        connection = make()
        connections[connection] = asyncio.current_task()
        try:
            await asyncio.get_running_loop().connect_accepted_socket(lambda: connection, accepted)
            await connection.gone.wait()
        finally:
            connections.pop(connection, None)
            connection.abort()

    async with accepting(listening, serve, linger=_LINGER):
        try:
            yield
        finally:
            for connection in connections:
                connection.end()


def _drop_silent(connections: dict[AcceptedConnection, asyncio.Task[Any] | None]) -> bool:
    """Disconnect the oldest connection that has not begun. Return whether there is one."""
    silent = next((connection for connection in connections if not connection.has_begun), None)
    if silent is None:
        return False
    if (task := connections.pop(silent)) is not None:
        task.cancel()
    return True
