"""Handlers of programs that read slowly or not at all."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from servolink.transports.listeners.accepted import LONGEST_PAUSE, MOST_UNREAD, AcceptedConnection


class Pipe(asyncio.Transport):
    """A connection on which a test says how much is not read yet."""

    unread = 0
    is_closed = False

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """Do nothing: the test pauses and resumes."""

    def get_write_buffer_size(self) -> int:
        return self.unread

    def is_closing(self) -> bool:
        return self.is_closed

    def write(self, data: Any) -> None:
        self.unread += len(data)

    def abort(self) -> None:
        self.is_closed = True


class SilentConnection(AcceptedConnection):
    """A connection that finds no handler by itself."""

    def _begin(self, data: bytes) -> None:
        """Do nothing."""


class Counting:
    """A handler that counts how often it is paused and resumed."""

    on_room: Callable[[], None] | None = None
    is_full = False
    waiting = 0
    pauses = resumes = 0

    def receive(self, data: bytes, /) -> None:
        """Do nothing."""

    def pause(self) -> None:
        self.pauses += 1

    def resume(self) -> None:
        self.resumes += 1

    def leave(self) -> None:
        """Do nothing."""


async def test_who_reads_slowly_is_kept_and_who_reads_nothing_is_not() -> None:
    line, pipe, program = SilentConnection(), Pipe(), Counting()
    line.connection_made(pipe)
    line._join(program)
    line.send(bytes(200_000))
    line.pause_writing()
    for _ in range(5):
        await asyncio.sleep(LONGEST_PAUSE - 1)
        pipe.unread -= 1
    assert not pipe.is_closing()
    pipe.unread = 0
    line.resume_writing()
    await asyncio.sleep(3 * LONGEST_PAUSE)
    assert not pipe.is_closing()
    assert (program.pauses, program.resumes) == (1, 1)
    line.send(bytes(200_000))
    line.pause_writing()
    await asyncio.sleep(LONGEST_PAUSE + 1)
    assert pipe.is_closing()
    line.send(b"more")
    line.connection_lost(None)
    assert pipe.unread == 200_000


async def test_a_handler_that_limits_unread_bytes_itself_keeps_a_program_that_reads() -> None:
    line, pipe = SilentConnection(), Pipe()
    line.connection_made(pipe)
    line._join(Counting(), is_bounded=True)
    line.send(bytes(MOST_UNREAD + 1))
    line.pause_writing()
    await asyncio.sleep(LONGEST_PAUSE - 1)
    pipe.unread -= 1
    await asyncio.sleep(LONGEST_PAUSE)
    assert not pipe.is_closing()
    await asyncio.sleep(LONGEST_PAUSE)
    assert pipe.is_closing()


async def test_a_program_that_need_not_read_is_kept() -> None:
    line, pipe, program = SilentConnection(), Pipe(), Counting()
    line.connection_made(pipe)
    line._join(program, must_read=False)
    line.send(bytes(MOST_UNREAD + 1))
    line.pause_writing()
    await asyncio.sleep(3 * LONGEST_PAUSE)
    assert not pipe.is_closing()
    line.resume_writing()
    assert (program.pauses, program.resumes) == (1, 1)
