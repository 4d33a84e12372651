"""Pipes to the hub for a program in another worker of the page, all over one message port.

The side of the program opens pipes, and the side of the hub connects pipes. Each message has a kind, the number of a
pipe, and a text in which bytes are characters from 0 to 255:

| kind | text |
| --- | --- |
| open | |
| data | bytes |
| read | number of bytes passed on so far |
| close | |
| hub | name of the hub, once, with number 0 |
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from itertools import count
from typing import TypeAlias

from servolink.support import Tasks

Post: TypeAlias = Callable[[str, int, str], object]
Connect: TypeAlias = Callable[[Callable[[], asyncio.Protocol]], Awaitable[object]]
_HIGH, _LOW = 64 * 1024, 16 * 1024  # bytes on the way, above and below which a side pauses and goes on
_MOST = 16 * _HIGH  # bytes on the way above which a pipe is closed
_MOST_PIPES = 16


class PortPipes:
    """Pipes over one port."""

    def __init__(self, post: Post, connect: Connect | None = None) -> None:
        """Call `post` with messages for the other side; `connect` a pipe of the other side, None to refuse all."""
        self.post = post
        self._connect = connect
        self._ends: dict[int, _PortEnd] = {}
        self._numbers = count(1)
        self._tasks = Tasks()

    def open(self) -> asyncio.Protocol:
        """Return the near end of a new pipe."""
        number = next(self._numbers)
        self.post("open", number, "")
        return self._join(number)

    def hear(self, kind: str, number: int, text: str) -> None:
        """Handle a message of the other side; ignore unknown messages."""
        end = self._ends.get(number)
        if kind == "open" and end is None and self._connect is not None and len(self._ends) < _MOST_PIPES:
            self._tasks.begin(self._accept(self._connect, self._join(number)))
        elif end is not None:
            try:
                end.hear(kind, text)
            except ValueError:
                end.abort()

    async def close(self) -> None:
        """Close all pipes at once: the other side is gone."""
        for end in tuple(self._ends.values()):
            end.abort()
        await self._tasks.close()

    def forget(self, number: int) -> None:
        """Tell the other side that a pipe is closed, unless both know."""
        if self._ends.pop(number, None) is not None:
            self.post("close", number, "")

    def _join(self, number: int) -> _PortEnd:
        end = self._ends[number] = _PortEnd(self, number)
        return end

    async def _accept(self, connect: Connect, end: _PortEnd) -> None:
        try:
            await connect(lambda: end)
        except (OSError, ValueError):
            self.forget(end.number)


class _PortEnd(asyncio.Protocol):
    """End of a pipe in this process; the port carries the bytes."""

    def __init__(self, pipes: PortPipes, number: int) -> None:
        self.number = number
        self._pipes = pipes
        self._pipe: asyncio.Transport | None = None
        self._early: list[bytes] = []
        self._is_over = self._is_paused = False
        self._posted = self._read = 0  # bytes given to the port, and bytes passed on by the other side
        self._heard = self._told = 0  # bytes from the port, and bytes reported as read

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - narrows the type
        self._pipe = transport
        for data in self._early:
            transport.write(data)
        if self._is_over:
            transport.close()
        self._tell_read()

    def data_received(self, data: bytes) -> None:
        self._posted += len(data)
        self._pipes.post("data", self.number, data.decode("latin-1"))
        if self._pipe is not None and self._posted - self._read > _HIGH:
            self._pipe.pause_reading()

    def pause_writing(self) -> None:
        self._is_paused = True

    def resume_writing(self) -> None:
        self._is_paused = False
        self._tell_read()

    def connection_lost(self, exc: Exception | None) -> None:
        self._pipes.forget(self.number)

    def hear(self, kind: str, text: str) -> None:
        """Handle a message about this pipe. Raise ValueError for an invalid message."""
        if kind == "close":
            self._is_over = True
            if self._pipe is not None:
                self._pipe.close()
        elif kind == "read":
            self._read = int(text)
            if self._pipe is not None and self._posted - self._read < _LOW:
                self._pipe.resume_reading()
        elif kind == "data":
            data = text.encode("latin-1")
            self._heard += len(data)
            if self._heard - self._told > _MOST:
                raise ValueError("more bytes than a program may send before they are read")
            if self._pipe is None:
                self._early.append(data)
            else:
                self._pipe.write(data)
            self._tell_read()

    def abort(self) -> None:
        """Close the pipe at once."""
        self._is_over = True
        if self._pipe is not None:
            self._pipe.abort()

    def _tell_read(self) -> None:
        if not self._is_paused and self._pipe is not None and self._told < self._heard:
            self._told = self._heard
            self._pipes.post("read", self.number, str(self._told))
