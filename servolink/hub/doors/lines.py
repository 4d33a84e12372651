"""Lines: what all doors on sockets share. One line carries the bytes of one program to its session and back."""

from __future__ import annotations

import asyncio
import logging
import socket
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager

from servolink.escaping import escape
from servolink.hub.engine.program import Program
from servolink.listeners import RareWarning, accepting
from servolink.tasks import Tasks

HIGH, LOW = 128 * 1024, 32 * 1024
"""Bytes that a program has not read, at which nothing more is asked for it, and at which it is again."""
MOST_UNREAD = 8 * 1024 * 1024
"""Bytes at which it is disconnected at once; a serial port drops what follows. What is under way brings less."""
LONGEST_PAUSE = 10.0
"""Seconds in which it reads nothing, after which it is disconnected."""

_CHUNK = 4096  # bytes that are read at once: hundreds of requests, of which the session takes no more for a while
_SEND_BUFFER = 64 * 1024  # in the system, which by itself would give MiB to each program that does not read
_LINGER = 0.5  # seconds for programs to read what they were sent before the hub ended
_NOT_READ = "it does not read what it asked for"
_logger = logging.getLogger(__name__)


class Line(asyncio.BufferedProtocol, ABC):
    """A connection of one program; a kind of door says how it begins, in `_begin`."""

    def __init__(self) -> None:
        """Start unconnected."""
        self.gone = asyncio.Event()
        """Set when the connection has ended."""
        self._loop = asyncio.get_running_loop()
        self._buffer = bytearray(_CHUNK)
        self._frames: list[bytes] = []
        self._pipe: asyncio.Transport | None = None
        self._program: Program | None = None
        self._written = 0
        self._timer: asyncio.TimerHandle | None = None  # while the program does not read

    @property
    def is_program(self) -> bool:
        """Whether the program has begun as it should."""
        return self._program is not None

    def end(self) -> None:
        """Close the connection; what was sent may still be read for a moment."""
        if self._pipe is not None:
            self._flush()
            self._pipe.close()

    def abort(self, reason: str) -> None:
        """Close the connection at once."""
        if self._pipe is not None and not self._pipe.is_closing():
            if reason:
                _logger.warning("%s was disconnected: %s", escape(self._who), escape(reason))
            self._pipe.abort()

    def send(self, frames: bytes) -> None:
        """Send frames to the program, together with all others of this turn of the loop if it waits for more."""
        if not self._frames and self._program is not None and not self._program.waiting:
            self._write(frames)
            return
        if not self._frames:
            self._loop.call_soon(self._flush)
        self._frames.append(frames)

    @property
    def _who(self) -> str:
        return "a program" if self._program is None else self._program.who

    @abstractmethod
    def _begin(self, data: bytes) -> None:
        """Take the first bytes, up to the call of `_joined`."""

    def _joined(self, program: Program) -> None:
        """Carry everything from now on to and from `program`."""
        self._program = program
        program.on_room = self._resume
        program.on_end = self.end

    def _receive(self, data: bytes) -> None:
        program = self._program
        if program is None:
            self._begin(data)
            return
        program.receive(data)
        if program.is_full and self._pipe is not None:
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
        if self._pipe.get_write_buffer_size() > MOST_UNREAD:
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
        transport.set_write_buffer_limits(HIGH, LOW)

    def get_buffer(self, sizehint: int) -> bytearray:
        """Return where to put the next bytes."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Take the next bytes."""
        self._receive(bytes(self._buffer[:nbytes]))

    def pause_writing(self) -> None:
        """Ask for nothing more until the program reads what it has."""
        if self._program is not None:
            self._program.pause()
            self._timer = self._loop.call_later(LONGEST_PAUSE, self._look, self._read_so_far())

    def resume_writing(self) -> None:
        """Ask again."""
        if self._program is not None:
            self._stop_timer()
            self._program.resume()

    def connection_lost(self, exc: Exception | None) -> None:
        """End the session."""
        self._stop_timer()
        self.gone.set()
        if self._program is not None:
            self._program.leave()


@asynccontextmanager
async def serve_lines(
    listening: Sequence[socket.socket], make: Callable[[], Line], *, most: int | None = None
) -> AsyncIterator[None]:
    """Make a line for each connection to these sockets, within this context; for at most about `most` at once.

    One more takes the place of that which has been connected longest without being a program, or is closed.
    """
    lines = dict[Line, None]()  # the oldest first
    tasks = Tasks()
    warning = RareWarning()

    async def serve(connection: socket.socket) -> None:
        line = make()
        try:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            await asyncio.get_running_loop().connect_accepted_socket(lambda: line, connection)
        except OSError:
            return  # the program is gone already
        lines[line] = None
        try:
            await line.gone.wait()
        finally:
            lines.pop(line, None)
            line.abort("")

    def start(connection: socket.socket) -> None:
        if most is not None and len(tasks) >= most:
            warning.log("%d connections are open: there is no room for more", most)
            if not _drop_silent(lines):
                connection.close()
                return
        task = tasks.begin(serve(connection))
        task.add_done_callback(lambda _: connection.close())  # if it was cancelled before it began

    try:
        async with accepting(listening, start):
            yield
    finally:
        for line in lines:
            line.end()
        await tasks.close(linger=_LINGER)
        await asyncio.sleep(0)  # in which asyncio closes what was aborted


def _drop_silent(lines: dict[Line, None]) -> bool:
    """Disconnect the oldest connection that is not a program. Return whether there is one."""
    silent = next((line for line in lines if not line.is_program), None)
    if silent is None:
        return False
    del lines[silent]
    silent.abort("")
    return True
