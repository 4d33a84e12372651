"""`record`: everything that passes between this program and a board, to a file."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from servolink.client.watch import MOST_HZ
from servolink.escaping import quote
from servolink.recorder.backlog import Backlog
from servolink.recorder.board_source import BoardTap, following
from servolink.recorder.channels import Event, Message, ProblemFound, Recorded, Wire
from servolink.recorder.clock import Clock
from servolink.recorder.writer import RecorderStatus, RecordingWriter

if TYPE_CHECKING:
    from servolink.client.board import Board

HZ = 20.0
"""Readings of the servos a second, unless told otherwise."""


class Recorder:
    """A recording that goes on."""

    def __init__(self, clock: Clock, backlog: Backlog, *, wire_only: bool = False) -> None:
        """Collect messages; `begin` writes them."""
        self.clock = clock
        self._backlog = backlog
        self._wire_only = wire_only
        self._writer: RecordingWriter | None = None

    def take(self, seconds: float, message: Message) -> None:
        """Record a message; never waits."""
        if not self._wire_only or isinstance(message, Wire | ProblemFound):
            self._backlog.put(seconds, message)

    def mark(self, text: str, *, who: str = "") -> None:
        """Record an event `mark` with this text, to find the moment again."""
        self.take(self.clock.now(), Event("mark", text[:200], who=who))

    def begin(self, path: Path, about: Recorded) -> None:
        """Write to a new file at `path` from now on, what was collected first. Raise RecordingError."""
        self._writer = RecordingWriter(path, about, self.clock, with_packets=not self._wire_only, backlog=self._backlog)

    @property
    def status(self) -> RecorderStatus:
        """How the recording goes on: size, messages, and what is missing or wrong."""
        assert self._writer is not None  # noqa: S101 - it has begun
        return self._writer.status()

    async def end(self) -> None:
        """Write what is left, and the end of the file. Raise RecordingError if that is impossible."""
        if self._writer is not None:
            await asyncio.to_thread(self._writer.close)


def describe(
    board: Board, clock: Clock, *, through: Literal["board", "hub", "ring", "spy"], hz: float, wire_only: bool
) -> Recorded:
    """Return the metadata of a recording of `board`."""
    name = board.profile.name if board.profile is not None else None
    return Recorded(
        version=version("servolink"),
        started=clock.started,
        board=name or board.url,
        through=through,
        byte_order=board.codec.byte_order,
        caption_encoding=board.codec.caption_encoding,
        hz=f"{hz:g}",
        channels="wire" if wire_only else "all",
    )


@asynccontextmanager
async def record(
    path: str | os.PathLike[str], board: Board, *, hz: float = HZ, wire_only: bool = False
) -> AsyncIterator[Recorder]:
    """Record everything that passes between this program and `board` to a new MCAP file, until the block ends.

    The servos are read `hz` times a second (0..1000; 0: never, then nothing is added to what the program sends), in
    common with whoever watches them. With `wire_only` only bytes are recorded. The file is written by a thread, and
    nothing here waits for it: what a slow disk cannot take is dropped, counted, and noted in the file.

    Raise RecordingError, which says what to do, if the file exists or cannot be written.
    """
    if not isinstance(hz, int | float) or isinstance(hz, bool) or not 0 <= hz <= MOST_HZ:
        raise ValueError(f"hz must be a number from 0 to {MOST_HZ:g}, not {quote(hz)}")
    clock = Clock(asyncio.get_running_loop().time)
    recorder = Recorder(clock, Backlog(), wire_only=wire_only)
    recorder.begin(Path(path), describe(board, clock, through="board", hz=hz, wire_only=wire_only))
    end_tap = board.connection.taps.add(BoardTap(recorder.take))
    try:
        async with following(board, recorder.take, hz=0.0 if wire_only else hz):
            yield recorder
    finally:
        end_tap()
        await recorder.end()
