"""Record a board without async."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from servolink import recorder
from servolink.recorder import RecorderStatus
from servolink.sync.board import Board, loop_and_board
from servolink.sync.loop_thread import LoopThread

HZ = 20.0
"""Default rate of readings in a recording, in Hz."""


class Recorder:
    """Recording in progress, made by `servolink.sync.record`, for use by any thread."""

    def __init__(self, thread: LoopThread, recording: recorder.Recorder) -> None:
        self._thread = thread
        self._recorder = recording

    def mark(self, text: str, *, who: str = "") -> None:
        """Record an event `mark` with a text, to find the moment again."""

        async def mark() -> None:
            self._recorder.mark(text, who=who)

        self._thread.run(mark)

    @property
    def status(self) -> RecorderStatus:
        """State of the recording: size, messages, losses and errors."""

        async def status() -> RecorderStatus:
            return self._recorder.status

        return self._thread.run(status)


@contextmanager
def record(
    path: str | os.PathLike[str], board: Board, *, hz: float = HZ, wire_only: bool = False
) -> Iterator[Recorder]:
    """Record the communication of all programs with `board` in a new MCAP file, until the block ends.

    Takes the arguments of `servolink.recorder.record`, and raises the same errors.
    """
    if not isinstance(board, Board):
        raise TypeError(f"board must be a board of servolink.sync, not {type(board).__name__}")
    thread, connected = loop_and_board(board)
    recording = recorder.record(path, connected, hz=hz, wire_only=wire_only)

    async def begin() -> recorder.Recorder:
        begun = await recording.__aenter__()
        thread.at_exit.add(end)  # another thread may be in the block at the end of the program
        return begun

    async def end() -> None:
        thread.at_exit.discard(end)
        await recording.__aexit__(None, None, None)

    begun = thread.run(begin)
    try:
        yield Recorder(thread, begun)
    finally:
        if thread.is_here and not thread.has_ended:  # after a fork, the parent process continues the recording
            thread.run(end)
