"""The relay: bytes from one side to the other, unchanged, at once, and never more than the other side takes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol, TypeAlias

from servolink.errors import ConnectionLost
from servolink.recorder.channels import Direction
from servolink.transports.stream import StreamTransport

Tap: TypeAlias = Callable[[float, Direction, bytes], None]
"""Is called with each chunk after it was passed on: seconds of the loop's clock, direction and bytes. Must not wait."""


class ProgramSide(Protocol):
    """Where the program connects: a pseudo-terminal or a TCP port. One program at a time."""

    def write(self, data: bytes) -> bool:
        """Give the program bytes; return whether it took all, or else calls `relay.program_has_room` later.

        Bytes for a program that is not there are dropped, as by a serial port that nobody has open.
        """
        ...

    def pause_reading(self) -> None:
        """Leave what the program writes to the system, so that it waits."""

    def resume_reading(self) -> None:
        """Read again."""


class Relay:
    """Joins the board's port and the program; it sends nothing of its own."""

    def __init__(self, board: StreamTransport, tap: Tap) -> None:
        """Start with a port that is not open yet, and without a program."""
        self._board = board
        self._tap = tap
        self._now = asyncio.get_running_loop().time
        self._program: ProgramSide | None = None
        self._lost: asyncio.Future[ConnectionLost | None] = asyncio.get_running_loop().create_future()
        board.on_taken = self._board_has_room

    async def open(self) -> None:
        """Open the board's port. Raise OpenError."""
        await self._board.open(self)

    def join(self, program: ProgramSide) -> None:
        """Pass on what comes from the board to `program` from now on."""
        self._program = program

    async def until_lost(self) -> ConnectionLost | None:
        """Return when the board's port has ended, with the cause."""
        return await asyncio.shield(self._lost)

    async def close(self) -> None:
        """Free the board's port."""
        await self._board.close()

    # --- from the board -----------------------------------------------------------------------------------------

    def data(self, chunk: bytes, /) -> None:
        """Pass on what the board said (called by the transport)."""
        if self._program is not None and not self._program.write(chunk):
            self._board.pause_reading()
        self._tap(self._now(), "received", chunk)

    def lost(self, error: Exception | None, /) -> None:
        """End (called by the transport)."""
        if not self._lost.done():
            self._lost.set_result(error if isinstance(error, ConnectionLost) else None)

    def program_has_room(self) -> None:
        """Read from the board again (called by the program's side)."""
        self._board.resume_reading()

    # --- from the program ---------------------------------------------------------------------------------------

    def heard(self, chunk: bytes) -> None:
        """Pass on what the program said (called by its side)."""
        now = self._now()
        try:
            has_room = self._board.pass_on(chunk)
        except ConnectionLost as error:
            self.lost(error)
            return
        if not has_room and self._program is not None:
            self._program.pause_reading()
        self._tap(now, "sent", chunk)

    def _board_has_room(self) -> None:
        if self._program is not None:
            self._program.resume_reading()
