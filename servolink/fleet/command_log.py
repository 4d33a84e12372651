"""CommandLog: commands accepted by a board, so that none is carried out twice, even after a crash.

A command is on the disk before it is carried out. What is found unfinished when the log is opened was interrupted:
nobody knows whether it was done, so it is not repeated, and its sender is told.
"""

from __future__ import annotations

import asyncio
import errno
import os
import time
from collections.abc import Awaitable, Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path

import msgspec
from msgspec import Struct

from servolink.errors import OpenError
from servolink.support import lock, reason, user_folder, write_atomically

MOST_KEPT = 4096
"""Most commands in the log; the oldest are forgotten first."""
LONGEST_KEPT = 24 * 3600.0
"""Seconds after which a command is forgotten when the log is opened, except the latest."""

_ALWAYS_KEPT = 256  # even if the clock was set
_PRIVATE = 0o700
_ENCODER = msgspec.json.Encoder()


class LogEntry(Struct, omit_defaults=True):
    """Line of the log: a new command, or a change of a known command."""

    id: str
    digest: str = ""
    """Of the payload: the same id must not stand for another command."""
    at: float = 0.0
    response_topic: str | None = None
    correlation: bytes | None = None
    answer: str | None = None
    """Result of the command, as soon as known."""
    is_over: bool = False
    """Whether the broker has the result."""


class CommandLog:
    """Log file with the commands of a board."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._entries: dict[str, LogEntry] = {}
        self._buffer: list[tuple[str, bytes]] = []
        """Ids and lines of the commands for the next write."""
        self._written: asyncio.Future[None]
        """Future of the next write to disk; unset without queued lines."""
        self._writer: asyncio.Task[None] | None = None
        self._file: FileIO | None = None
        self._lines = 0

    def open(self) -> None:
        """Read the file and shorten it."""
        self._read()
        kept = self._compact()
        self._entries = {entry.id: entry for entry in kept}

    def close(self) -> None:
        """Write the queued lines and close the file."""
        if self._file is not None:
            self._append([line for _, line in self._taken()])
            self._file.close()

    def unfinished(self) -> list[LogEntry]:
        """Return the commands whose result the broker has not got."""
        return [entry for entry in self._entries.values() if not entry.is_over]

    def find(self, command_id: str) -> LogEntry | None:
        """Return the command with the id, None for an unknown id."""
        return self._entries.get(command_id)

    def note(self, entry: LogEntry, *, only_reads: bool = False) -> Awaitable[None]:
        """Make a command known immediately, and return the awaitable of the write to disk.

        That, or this call, raises OSError if it cannot be written: then the command is not known any more.

        Commands that come together are written together, or none of them. One that `only_reads` is written, too, but
        the disk is not waited for: no crash of this program loses it, and it can be repeated when the power has failed.
        """
        line, loop = _ENCODER.encode(entry), asyncio.get_running_loop()
        if only_reads and not (self._is_writing or self._is_long):
            self._append([line])
            self._know(entry)
            done = loop.create_future()
            done.set_result(None)
            return done
        self._know(entry)
        if not self._buffer:
            self._written = loop.create_future()
        self._buffer.append((entry.id, line))
        if not self._is_writing:
            self._writer = loop.create_task(self._write_batches())
        return asyncio.shield(self._written)  # shielded: a canceled waiter must not end the wait of the others

    def answered(self, command_id: str, answer: str) -> None:
        """Remember the result of a command until the broker has confirmed."""
        self._add(command_id, LogEntry(command_id, answer=answer))

    def over(self, command_id: str) -> None:
        """Remember that the broker has the result of a command."""
        self._add(command_id, LogEntry(command_id, is_over=True))

    def _add(self, command_id: str, news: LogEntry) -> None:
        """Write with the next command, or in a moment: a lost line costs a repeated result, not a repeated motion."""
        entry = self._entries.get(command_id)
        if entry is None:
            return
        _update(entry, news)
        with suppress(OSError, ValueError):  # ValueError: the file is being shortened, with the line included
            self._append([_ENCODER.encode(news)])

    @property
    def _is_long(self) -> bool:
        return self._lines >= 4 * MOST_KEPT

    @property
    def _is_writing(self) -> bool:
        return self._writer is not None and not self._writer.done()

    def _know(self, entry: LogEntry) -> None:
        self._entries[entry.id] = entry
        while len(self._entries) > MOST_KEPT:
            self._entries.pop(next(iter(self._entries)))

    def _taken(self) -> list[tuple[str, bytes]]:
        taken, self._buffer = self._buffer, []
        return taken

    async def _write_batches(self) -> None:
        """Write queued commands, including commands queued meanwhile. All commands of a batch are noted, or none."""
        while self._buffer:
            written, batch = self._written, self._taken()
            try:
                await asyncio.to_thread(self._write, [line for _, line in batch])
            except (OSError, ValueError) as error:  # ValueError: the log was closed meanwhile
                for command_id, _ in batch:
                    self._entries.pop(command_id, None)
                written.set_exception(error)
                written.exception()  # seen, even if nobody waits any more
            else:
                written.set_result(None)

    def _write(self, lines: list[bytes]) -> None:
        if self._is_long:
            self._compact()
            return
        self._append(lines)
        if self._file is not None:
            os.fsync(self._file.fileno())

    def _append(self, lines: list[bytes]) -> None:
        if self._file is None:
            return
        # A line break before, too: a line cut short by a full disk must not spoil the next line.
        text = b"\n" + b"\n".join(lines) + b"\n"
        if self._file.write(text) != len(text):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._lines += len(lines)

    def _read(self) -> None:
        try:
            text = self._path.read_bytes()
        except FileNotFoundError:
            return
        for line in text.splitlines():
            try:
                news = msgspec.json.decode(line, type=LogEntry)
            except msgspec.MsgspecError:  # the end of the power in the middle of a line
                continue
            entry = self._entries.get(news.id)
            if entry is None:
                self._entries[news.id] = news
            else:
                _update(entry, news)

    def _compact(self) -> list[LogEntry]:
        """Write only commands worth keeping, and return them."""
        oldest = time.time() - LONGEST_KEPT
        entries = list(self._entries.values())[-MOST_KEPT:]
        late, latest = entries[:-_ALWAYS_KEPT], entries[-_ALWAYS_KEPT:]
        kept = [entry for entry in late if entry.at > oldest or not entry.is_over] + latest
        if self._file is not None:
            self._file.close()
        write_atomically(self._path, b"".join(_ENCODER.encode(entry) + b"\n" for entry in kept), private=True)
        self._lines = len(kept)
        self._file = open(self._path, "ab", buffering=0)  # noqa: SIM115 - closed by `close`
        return kept


def _update(entry: LogEntry, news: LogEntry) -> None:
    entry.is_over = entry.is_over or news.is_over
    entry.answer = None if entry.is_over else news.answer or entry.answer


@contextmanager
def opened_command_log(board: str) -> Iterator[CommandLog]:
    """Open the log of a board, for exclusive use by this program. Raise OpenError on failure."""
    try:
        folder = user_folder("data") / "fleet"
        folder.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)
        claim = open(folder / f"{board}.lock", "ab", buffering=0)  # noqa: SIM115 - closed below
    except OSError as error:
        raise OpenError(f"the commands of {board} cannot be noted: {reason(error)}") from error
    with claim:
        if not lock(claim, wait=False):
            raise OpenError(
                f"another program of this machine connects {board} with a broker already; end that one first"
            )
        command_log = CommandLog(folder / f"{board}.journal")
        try:
            command_log.open()
        except OSError as error:
            raise OpenError(f"the commands of {board} cannot be noted: {reason(error)}") from error
        try:
            yield command_log
        finally:
            command_log.close()
