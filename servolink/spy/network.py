"""A TCP port for the program, for those that know serial ports of other machines."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from servolink.listeners import accepting, listening_sockets, place_of
from servolink.spy.relay import Relay
from servolink.tasks import Tasks
from servolink.transports.stream import keep_alive

_NO_BOARD = (b"GET ", b"HEAD ", b"POST ", b"PUT ", b"DELETE ", b"OPTIONS ", b"PATCH ", b"CONNECT ", b"\x16\x03")
"""The first bytes of a browser. Any web page can make one connect to this port, and send frames to the board."""
_SEND_BUFFER = 65536  # in the system, which by itself would take MiB for a program that does not read


class NetworkSide:
    """The connection of one program; others are refused meanwhile."""

    def __init__(self, relay: Relay, on_program: Callable[[bool], object]) -> None:
        """Start without a program; `on_program` is called with whether one is connected."""
        self.relay = relay
        self.on_program = on_program
        self._line: _Line | None = None

    def write(self, data: bytes) -> bool:
        """Give the program bytes; drop them if there is none."""
        return self._line is None or self._line.write(data)

    def pause_reading(self) -> None:
        """Stop reading, so that the program waits."""
        if self._line is not None:
            self._line.pipe.pause_reading()

    def resume_reading(self) -> None:
        """Read again."""
        if self._line is not None and not self._line.pipe.is_closing():
            self._line.pipe.resume_reading()

    def take(self, line: _Line) -> bool:
        """Return whether `line` may stay: no other program is there."""
        if self._line is not None:
            return False
        self._line = line
        self.on_program(True)  # noqa: FBT003 - it is there
        return True

    def leave(self, line: _Line) -> None:
        """Forget a program that has gone."""
        if self._line is line:
            self._line = None
            self.relay.program_has_room()
            self.on_program(False)  # noqa: FBT003 - it is gone

    def close(self) -> None:
        """Disconnect the program."""
        if self._line is not None:
            self._line.pipe.abort()


class _Line(asyncio.Protocol):
    pipe: asyncio.Transport

    def __init__(self, side: NetworkSide) -> None:
        self._side = side
        self._is_full = False
        self._is_checked = False

    def write(self, data: bytes) -> bool:
        self.pipe.write(data)
        return not self._is_full

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - narrows the type
        self.pipe = transport
        transport.set_write_buffer_limits(high=0)
        if not self._side.take(self):
            transport.abort()

    def data_received(self, data: bytes) -> None:
        if not self._is_checked and data.startswith(_NO_BOARD):
            self.pipe.abort()
            return
        self._is_checked = True
        self._side.relay.heard(data)

    def pause_writing(self) -> None:
        self._is_full = True

    def resume_writing(self) -> None:
        self._is_full = False
        self._side.relay.program_has_room()

    def connection_lost(self, exc: Exception | None) -> None:
        self._side.leave(self)


@asynccontextmanager
async def serve_program(side: NetworkSide, host: str, port: int) -> AsyncIterator[str]:
    """Listen for programs within this context; yield the URL. Raise OpenError if the place cannot be had."""
    import socket

    loop = asyncio.get_running_loop()
    tasks = Tasks()

    def start(connection: socket.socket) -> None:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        keep_alive(connection, idle=60, interval=15, count=4)
        tasks.begin(loop.create_connection(lambda: _Line(side), sock=connection))

    listening = await listening_sockets(host, port)
    try:
        async with accepting(listening, start):
            yield f"tcp://{place_of(listening)}"
    finally:
        side.close()
