"""Relay: bytes between a program and a board, unchanged, without delay, and never more than a side accepts.

The program finds a pseudo-terminal or a TCP port in place of the board, one program at a time.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, closing, contextmanager
from pathlib import Path
from typing import TypeAlias

from servolink.errors import ConnectionLost
from servolink.recorder import Direction
from servolink.transports import AcceptedConnection, NetworkPlace, ServedTerminal, StreamTransport

Tap: TypeAlias = Callable[[float, Direction, bytes], None]
"""Called with each chunk after forwarding: seconds of the loop's clock, direction and bytes. Must not wait."""


class Relay:
    """Handler of one program at a time: bytes go to and from the port of the board, and none are added."""

    waiting = 0

    def __init__(self, board: StreamTransport, tap: Tap, on_program: Callable[[bool], object]) -> None:
        """Start with a port that is not open yet; call `on_program` with whether a program is connected."""
        self.sink: Callable[[bytes], object] | None = None
        """Function that sends to the program; without one, bytes are dropped, as by a closed serial port."""
        self.has_program = False
        """Whether a program is connected."""
        self.is_full = False
        """Whether reading from the program must pause, because the board does not accept more bytes."""
        self.on_room: Callable[[], None] | None = None
        """Function to call when `is_full` ends."""
        self._board = board
        self._tap = tap
        self._on_program = on_program
        self._now = asyncio.get_running_loop().time
        self._lost: asyncio.Future[ConnectionLost | None] = asyncio.get_running_loop().create_future()
        board.on_accepted = self._board_has_room

    async def open(self) -> None:
        """Open the board's port. Raise OpenError."""
        await self._board.open(self)

    async def until_lost(self) -> ConnectionLost | None:
        """Return when the board's port has ended, with the cause."""
        return await asyncio.shield(self._lost)

    async def close(self) -> None:
        """Free the board's port."""
        await self._board.close()

    # --- from the board -----------------------------------------------------------------------------------------

    def data(self, chunk: bytes, /) -> None:
        """Pass bytes of the board on (called by the transport)."""
        if self.sink is not None:
            self.sink(chunk)
        self._tap(self._now(), "received", chunk)

    def lost(self, error: Exception | None, /) -> None:
        """End (called by the transport)."""
        if not self._lost.done():
            self._lost.set_result(error if isinstance(error, ConnectionLost) else None)

    def _board_has_room(self) -> None:
        self.is_full = False
        if self.on_room is not None:
            self.on_room()

    # --- from the program ---------------------------------------------------------------------------------------

    def join(self, sink: Callable[[bytes], object]) -> Relay:
        """Handle a program, with `sink` as the way to it; return this object."""
        self.sink = sink
        self.has_program = True
        self._on_program(True)  # noqa: FBT003 - it is there
        return self

    def receive(self, data: bytes, /) -> None:
        """Pass bytes of the program on."""
        now = self._now()
        try:
            self.is_full = not self._board.pass_on(data)
        except ConnectionLost as error:
            self.lost(error)
            return
        self._tap(now, "sent", data)

    def pause(self) -> None:
        """Stop reading from the board, which may slow the board down: the program does not read."""
        self._board.pause_reading()

    def resume(self) -> None:
        """Read from the board again."""
        self._board.resume_reading()

    def leave(self) -> None:
        """Forget the program after its end."""
        self.on_room = None
        self.has_program = False
        self._board.resume_reading()
        self._on_program(False)  # noqa: FBT003 - it is gone

    @contextmanager
    def on_terminal(
        self, link: str | Path | None, baudrate: int, on_baudrate: Callable[[int], object]
    ) -> Iterator[str]:
        """Serve programs on a new pseudo-terminal within this context, linked at `link` unless None; yield the URL.

        Programs find this baud rate; `on_baudrate` is called with each other rate that one sets. Raise OpenError if the
        link cannot be made, TransportUnavailable on Windows.
        """
        terminal = ServedTerminal(
            lambda each: self.join(each.send), high=0, low=0, look=_LOOK, baudrate=baudrate, on_baudrate=on_baudrate
        )
        self.sink = terminal.send  # which looks for a program first
        with closing(terminal), terminal.address(link) as url:
            yield url

    @asynccontextmanager
    async def on_network(self, host: str, port: int) -> AsyncIterator[str]:
        """Serve programs at a TCP port within this context; yield the URL. Raise OpenError if the port is taken."""
        listening = await NetworkPlace(host, port).listen()
        async with AcceptedConnection.serving(listening, lambda: _ProgramConnection(self)):
            yield f"tcp://{NetworkPlace.of(listening)}"


# --- places for the program -------------------------------------------------------------------------------------------


_NO_BOARD = (b"GET ", b"HEAD ", b"POST ", b"PUT ", b"DELETE ", b"OPTIONS ", b"PATCH ", b"CONNECT ", b"\x16\x03")
"""First bytes of browsers: any web page can make a browser connect to the port and send frames to the board."""
_LOOK = 0.01  # seconds between looks for a program, whose first bytes wait meanwhile


class _ProgramConnection(AcceptedConnection):
    """Connection of the present program; others are refused meanwhile."""

    def __init__(self, relay: Relay) -> None:
        super().__init__(high=0, low=0)
        self._relay = relay
        self._is_checked = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if self._relay.has_program:
            self.abort()
        else:
            self._join(self._relay.join(self.send), must_read=False)  # the board waits for the program

    def _begin(self, data: bytes) -> None:
        """Ignore the bytes of a refused program."""

    def _receive(self, data: bytes) -> None:
        if not self._is_checked and data.startswith(_NO_BOARD):
            self.abort()
            return
        self._is_checked = True
        super()._receive(data)
