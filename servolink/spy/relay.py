"""Relay: bytes from one side to the other, unchanged, without delay, and never more than the other side accepts."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeAlias

from servolink.errors import ConnectionLost
from servolink.recorder.channels import Direction
from servolink.transports.stream import StreamTransport

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
