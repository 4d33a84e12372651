"""Pipes between programs of one process, where the system has no sockets: a page in a browser.

Both ends are transports of asyncio with limits for unread bytes, so that a program which does not read pauses the other
as it would through a socket.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias, cast

MakeProtocol: TypeAlias = Callable[[], asyncio.BaseProtocol]
_HAS_SOCKETS = sys.platform != "emscripten"
"""Whether programs of other processes can connect; False in a page of a browser."""
_HIGH, _LOW = 64 * 1024, 16 * 1024  # bytes, as for sockets in asyncio
_listening: dict[str, MakeProtocol] = {}


@contextmanager
def listening_in_memory(name: str, make_protocol: MakeProtocol) -> Iterator[bool]:
    """Connect programs of this process under `name`, within the context, each to an own protocol; yield True.

    Where the system has sockets, have no effect, and yield False.
    """
    if _HAS_SOCKETS:
        yield False
        return
    if name in _listening:
        raise FileExistsError(f"{name} is listened to already")
    _listening[name] = make_protocol
    try:
        yield True
    finally:
        del _listening[name]


def connect_in_memory(name: str, make_protocol: MakeProtocol) -> asyncio.Transport:
    """Connect to the program listening under `name`. Raise ConnectionRefusedError if none is."""
    if name not in _listening:
        raise ConnectionRefusedError(f"no program listens as {name}")
    near, far = _PipeEnd(), _PipeEnd()
    near.peer, far.peer = far, near
    far.begin(_listening[name]())
    near.begin(make_protocol())
    return near


class _PipeEnd(asyncio.Transport):
    """One end of a pipe: what is written arrives at the protocol of the other end, in a later turn of the loop."""

    peer: _PipeEnd

    def __init__(self) -> None:
        super().__init__()
        self._loop = asyncio.get_running_loop()
        self._protocol: asyncio.BaseProtocol
        self._unread = bytearray()  # on the way to the other end
        self._limits = _HIGH, _LOW
        self._reads = True
        self._is_full = False
        self._is_closing = False
        self._has_ended = False
        self._passing: asyncio.Handle | None = None

    def begin(self, protocol: asyncio.BaseProtocol) -> None:
        """Tell the protocol of this end that it is connected."""
        self._protocol = protocol
        protocol.connection_made(self)

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """Return the default: nothing is known about a pipe."""
        return default

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        """Pass further bytes to `protocol`."""
        self._protocol = protocol

    def get_protocol(self) -> asyncio.BaseProtocol:
        """Return the protocol of this end."""
        return self._protocol

    def is_closing(self) -> bool:
        """Return whether nothing can be written any more."""
        return self._is_closing

    def is_reading(self) -> bool:
        """Return whether bytes are passed to the protocol."""
        return self._reads and not self._has_ended

    def pause_reading(self) -> None:
        """Keep further bytes until `resume_reading`."""
        self._reads = False

    def resume_reading(self) -> None:
        """Pass bytes to the protocol again."""
        self._reads = True
        self.peer.pass_on()

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """Pause the protocol while more than `high` bytes are unread, until `low` are."""
        high = _HIGH if high is None else high
        self._limits = high, high // 4 if low is None else low

    def get_write_buffer_size(self) -> int:
        """Return the number of unread bytes."""
        return len(self._unread)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send bytes to the other end; dropped after the end."""
        if self._is_closing:
            return
        self._unread += data
        self.pass_on()
        if len(self._unread) > self._limits[0] and not self._is_full:
            self._is_full = True
            cast("asyncio.Protocol", self._protocol).pause_writing()

    def can_write_eof(self) -> bool:
        """Return False: an end closes both directions."""
        return False

    def close(self) -> None:
        """Close the pipe once the other end has read everything."""
        self._is_closing = True
        self.pass_on()

    def abort(self) -> None:
        """Close the pipe at once; unread bytes are lost."""
        self._is_closing = True
        self._unread.clear()
        self.pass_on()

    def pass_on(self) -> None:
        """Pass unread bytes to the other end, or the end, in the next turn of the loop."""
        if self._passing is None and not self._has_ended and (self._unread or self._is_closing):
            self._passing = self._loop.call_soon(self._pass_now)

    def _pass_now(self) -> None:
        self._passing = None
        if self._unread and self.peer.is_reading():
            data, self._unread = bytes(self._unread), bytearray()
            _deliver(self.peer.get_protocol(), data)
            if self._is_full and len(self._unread) <= self._limits[1]:
                self._is_full = False
                cast("asyncio.Protocol", self._protocol).resume_writing()
        if self._is_closing and not self._unread:
            for end in (self.peer, self):
                end.end()

    def end(self) -> None:
        """Tell the protocol of this end, once, that the pipe is closed."""
        if not self._has_ended:
            self._has_ended = self._is_closing = True
            self._unread.clear()
            self._loop.call_soon(self._protocol.connection_lost, None)


def _deliver(protocol: asyncio.BaseProtocol, data: bytes) -> None:
    """Give bytes to a protocol of either kind of asyncio."""
    if not isinstance(protocol, asyncio.BufferedProtocol):
        cast("asyncio.Protocol", protocol).data_received(data)
        return
    while data:
        buffer = protocol.get_buffer(len(data))
        count = min(len(buffer), len(data))  # type: ignore[arg-type]
        memoryview(buffer)[:count] = data[:count]
        protocol.buffer_updated(count)
        data = data[count:]
