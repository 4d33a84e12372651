"""RingWriter: the last seconds in bounded memory, written after a failure or on request."""

from __future__ import annotations

import os
import threading
import zlib
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from servolink.errors import RecordingError
from servolink.recorder.backlog import Backlog, Timed
from servolink.recorder.channels import TOPICS, CommandDone, Event, Message, Recorded, encode
from servolink.recorder.clock import BILLION, Clock
from servolink.recorder.recording_file import Disk, RecordingFile
from servolink.recorder.writer import CHUNK_BYTES, CHUNK_SECONDS, LOOK_EVERY, MessageEncoder, RecorderStatus, Saved
from servolink.support import MIB

MOST_BYTES = 64 * MIB
"""Limit of compressed messages in bytes, for any duration."""


class _Segment(NamedTuple):
    """Compressed messages with their times."""

    first: float
    last: float
    messages: int
    data: bytes


class Segments:
    """Latest messages, limited in time and in bytes."""

    def __init__(self, seconds: float, most_bytes: int = MOST_BYTES) -> None:
        self._seconds = seconds
        self._most_bytes = most_bytes
        self._closed: deque[_Segment] = deque()
        self._open: list[tuple[float, str, bytes]] = []
        self._open_bytes = 0
        self.size = 0
        """Total bytes of the closed segments."""
        self.count = 0
        """Number of all messages."""

    @property
    def first(self) -> float | None:
        """Time of the oldest message; None without messages."""
        return self._closed[0].first if self._closed else self._open[0][0] if self._open else None

    def add(self, timed: Timed) -> None:
        """Add a message, and drop messages too old or too many."""
        data = encode(timed.message)
        self._open.append((timed.seconds, TOPICS[type(timed.message)], data))
        self._open_bytes += len(data)
        self.count += 1
        if self._open_bytes >= CHUNK_BYTES or timed.seconds - self._open[0][0] >= CHUNK_SECONDS:
            self._close()
        self._trim(timed.seconds)

    def messages(self) -> Iterator[tuple[float, str, bytes]]:
        """Yield all messages, with their topics; a single segment is unpacked at a time."""
        for segment in self._closed:
            yield from msgspec.msgpack.decode(zlib.decompress(segment.data), type=list[tuple[float, str, bytes]])
        yield from self._open

    def clear(self) -> None:
        """Drop all messages in memory."""
        while self._closed:
            self._drop()
        self._open, self._open_bytes, self.count = [], 0, 0

    def _close(self) -> None:
        data = zlib.compress(msgspec.msgpack.encode(self._open), 1)
        self._closed.append(_Segment(self._open[0][0], self._open[-1][0], len(self._open), data))
        self.size += len(data)
        self._open, self._open_bytes = [], 0

    def _trim(self, now: float) -> None:
        while self._closed and (self._closed[0].last < now - self._seconds or self.size > self._most_bytes):
            self._drop()

    def _drop(self) -> None:
        segment = self._closed.popleft()
        self.size -= len(segment.data)
        self.count -= segment.messages


AFTER = 2.0
"""Seconds recorded after a failure before the writing; further failures meanwhile count as the same."""
_AGAIN = 1.0  # seconds until the next attempt on a disk that refuses data
_STOP = {"servo_id": 255, "is_start": 0, "is_hold": 1}


def trigger(message: Message) -> str:
    """Return the reason to write the ring after a message; empty without a reason."""
    match message:
        case Event(kind="connection", what="lost"):
            return message.text or "the connection was lost"
        case Event(kind="alarm"):
            return message.what
        case CommandDone(outcome="unknown"):
            return f"the outcome of {message.packet} is unknown"
        case CommandDone(packet="SetServoParameterRequest") if _fields(message.fields) == _STOP:
            return f"{message.who or 'the program'} has stopped the servos"
        case _:
            return ""


def _fields(fields: Any) -> Any:
    return fields if isinstance(fields, dict) else msgspec.to_builtins(fields)


class RingWriter:
    """Keeps the latest messages, and writes files after failures; on a separate thread."""

    def __init__(
        self,
        path: Path,
        about: Recorded,
        clock: Clock,
        seconds: float,
        *,
        backlog: Backlog | None = None,
        disk: Disk = os,
    ) -> None:
        """Keep the last `seconds`; file names are `path` with the time added. Raise RecordingError if impossible."""
        MessageEncoder(about, clock)  # raises the error for a missing library
        if not path.parent.is_dir():
            raise RecordingError(f"cannot record to {path}: the folder {path.parent} does not exist; create it first")
        self._path = path
        self._about = about
        self._clock = clock
        self._backlog = backlog or Backlog()
        self._disk = disk
        self._segments = Segments(seconds)
        self._saved: tuple[Saved, ...] = ()
        self._asked: list[str] = []
        self._reason = ""
        self._due = 0.0
        self._problem = ""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"recorder of {path.name}", daemon=True)
        self._thread.start()

    def save(self, reason: str) -> None:
        """Write the kept messages soon."""
        self._asked.append(reason)

    def fail(self, reason: str) -> None:
        """Write the kept messages some seconds later, as after a message about a failure."""
        if not self._reason:
            self._reason, self._due = reason, self._clock.now() + AFTER

    def status(self) -> RecorderStatus:
        """Return the state of the recording; the size is the size in memory."""
        segments, now = self._segments, self._clock.now()
        first = segments.first
        seconds = 0.0 if first is None else now - first
        dropped = self._backlog.dropped
        return RecorderStatus(
            str(self._path), seconds, segments.size, segments.count, dropped, self._problem, saved=self._saved
        )

    def close(self) -> None:
        """End, after writing a file still due after a failure. Raise RecordingError if the writing fails."""
        self._closing.set()
        self._thread.join()
        if self._problem:
            raise RecordingError(f"{self._path}: the recording could not be written: {self._problem}")

    # --- on the thread ------------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self._keep()
        except Exception as error:  # noqa: BLE001 - a defect of ours, which `close` raises
            self._problem = f"the recorder has failed: {error}"

    def _keep(self) -> None:
        while not self._closing.wait(LOOK_EVERY):
            self._drain()
            now = self._clock.now()
            if self._asked:
                self._save(self._asked.pop(0))
            elif self._reason and now >= self._due:
                self._save(self._reason)
        self._drain()
        if self._reason or self._asked:
            self._save(self._reason or self._asked[0])

    def _drain(self) -> None:
        while (timed := self._backlog.take()) is not None:
            self._segments.add(timed)
            if reason := trigger(timed.message):
                self.fail(reason)

    def _save(self, reason: str) -> None:
        """Write all kept messages to a new file, and drop the messages; if the disk is full, try again later."""
        path = self._free_path()
        try:
            size = self._write(path, reason)
        except RecordingError as error:
            self._problem, self._reason, self._due = str(error), reason, self._clock.now() + _AGAIN
            with suppress(OSError):
                path.unlink()
            return
        self._saved = (*self._saved, Saved(str(path), reason, size))
        self._problem = self._reason = ""
        self._asked.clear()
        self._segments.clear()

    def _write(self, path: Path, reason: str) -> int:
        first = self._segments.first
        start = self._clock.now() if first is None else first
        about = msgspec.structs.replace(self._about, started=self._clock.iso(start))
        encoder = MessageEncoder(about, self._clock)
        file = RecordingFile(path, disk=self._disk)
        try:
            file.put(encoder.stream.head())
            for seconds, topic, data in self._segments.messages():
                encoder.add_encoded(seconds, topic, data)
                if encoder.stream.waiting >= CHUNK_BYTES:
                    _check(file, file.put(encoder.stream.chunk()))
            encoder.add(Timed(self._clock.now(), Event("recorder", "saved", text=reason)))
            _check(file, file.put(encoder.stream.chunk() + encoder.stream.end()))
            return file.size
        finally:
            file.close()

    def _free_path(self) -> Path:
        """Return the path of a new file."""
        now = datetime.fromtimestamp(self._clock.wall(self._clock.now()) // BILLION, UTC)
        stem = f"{self._path.stem}-{now:%Y%m%d-%H%M%S}"
        suffix, number = self._path.suffix or ".mcap", 1
        path = self._path.with_name(f"{stem}{suffix}")
        while path.exists():
            number += 1
            path = self._path.with_name(f"{stem}-{number}{suffix}")
        return path


def _check(file: RecordingFile, is_written: bool) -> None:  # noqa: FBT001 - what `put` returns
    """Raise RecordingError if the disk did not take a block."""
    if not is_written:
        raise RecordingError(f"cannot write {file.path}: {file.problem}")
