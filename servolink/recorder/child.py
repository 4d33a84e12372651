"""Recording in a separate process: `python -m servolink.recorder.child` writes the messages of a ChildWriter.

Decoding packets takes longer than sending them. A thread of the recorded program would take the time from the program;
a separate process does not, and gives the file a proper end even if the program crashes.

Standard input has an `Order`, then batches of messages, each after its length; standard output has a status as a line
of JSON now and then, and a last status when the input has ended and the file is written.
"""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO, BinaryIO, cast

import msgspec
from msgspec import Struct

from servolink.errors import DecodeError, RecordingError
from servolink.recorder.backlog import Backlog
from servolink.recorder.channels import TOPICS, Direction, Message, Recorded, Wire, decode, encode
from servolink.recorder.clock import Clock
from servolink.recorder.writer import LOOK_EVERY, RecorderStatus, RecordingWriter

LENGTH = struct.Struct("<I")
Batch = list[tuple[float, str, bytes]]
"""Seconds, topic, and the JSON of each message; for bytes of the line `sent` or `received`, and the bytes."""
_DIRECTIONS = {"sent", "received"}
_STATUS_EVERY = 0.25  # seconds
_MOST_AT_ONCE = 1000  # messages in a batch: the program waits during the packing
_PATIENCE = 30.0  # seconds for the process to write the rest
_GONE = "the writing process has ended; was the process killed?"
_NICE = 5  # lower priority than the recorded program


class Order(Struct):
    """Settings of a recording for the writing process."""

    path: str
    about: Recorded
    monotonic: float
    """Start of the recording, on the clock of the messages."""
    wall: int
    """Start of the recording, in nanoseconds since 1970."""


class ChildReport(Struct):
    """Status of the process, a line of standard output."""

    status: RecorderStatus
    error: str = ""
    """Reason of a failed recording; empty without a failure."""


def main() -> None:
    """Write a single recording from standard input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program; the end of the program ends this process
    if hasattr(os, "nice"):
        os.nice(_NICE)
    source = sys.stdin.buffer
    first = _read(source)
    if first is None:
        return
    order = msgspec.msgpack.decode(first, type=Order)
    clock = Clock(time.monotonic, wall=order.wall, monotonic=order.monotonic)
    try:
        writer = RecordingWriter(Path(order.path), order.about, clock)
    except RecordingError as error:
        _report(ChildReport(RecorderStatus(order.path, 0.0, 0, 0, 0, ""), str(error)))
        return
    ended = threading.Event()
    telling = threading.Thread(target=_tell, args=(writer, ended), daemon=True)
    _report(ChildReport(writer.status()))
    telling.start()
    while (batch := _read(source)) is not None:
        _take(writer, batch)
    error_text = ""
    try:
        writer.close()
    except RecordingError as error:
        error_text = str(error)
    ended.set()
    telling.join()
    _report(ChildReport(writer.status(), error_text))


def _read(source: BinaryIO) -> bytes | None:
    """Return the next batch; None at the end of the input, even within a batch: the program has crashed."""
    head = source.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack(head)
    data = source.read(length)
    return data if len(data) == length else None


def _take(writer: RecordingWriter, batch: bytes) -> None:
    for seconds, topic, data in msgspec.msgpack.decode(batch, type=Batch):
        if topic in _DIRECTIONS:
            writer.take(seconds, Wire(cast("Direction", topic), data, seconds))
        else:
            try:
                writer.take(seconds, decode(topic, data))
            except DecodeError:  # a defect of ours; the rest is worth more than an end
                continue


def _tell(writer: RecordingWriter, ended: threading.Event) -> None:
    while not ended.wait(_STATUS_EVERY):
        _report(ChildReport(writer.status()))


def _report(report: ChildReport) -> None:
    try:
        # Unbuffered: at exit, Python would try again to write the buffered rest, and report an error.
        os.write(sys.stdout.fileno(), msgspec.json.encode(report) + b"\n")
    except OSError:
        return  # the program has crashed


class ChildWriter:
    """Passes a recording to a separate process; two threads wait for the pipes."""

    def __init__(self, path: Path, about: Recorded, clock: Clock, *, backlog: Backlog | None = None) -> None:
        """Start the process, and wait for the new file. Raise RecordingError naming the remedy."""
        self._path = path
        self._clock = clock
        self._backlog = backlog or Backlog(why="the recording process is too slow")
        command = (sys.executable, "-m", "servolink.recorder.child")
        try:
            # In a session of its own: Ctrl-C and a closed terminal must end the program, not the recording.
            process = subprocess.Popen(  # noqa: S603 - our own program
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
            )
        except OSError as error:
            raise RecordingError(f"cannot record: {error}") from error
        assert process.stdin is not None  # noqa: S101 - it is a pipe
        assert process.stdout is not None  # noqa: S101 - it is a pipe
        self._process, self._sink, self._source = process, process.stdin, process.stdout
        self._closing = threading.Event()
        self._is_broken = False
        order = Order(str(path.absolute()), about, clock.monotonic, clock.wall(clock.monotonic))
        self._send(self._sink, msgspec.msgpack.encode(order))
        self._report = self._next_report() or ChildReport(RecorderStatus(str(path), 0.0, 0, 0, 0, ""), _GONE)
        if self._report.error:
            self._end_process()
            raise RecordingError(self._report.error)
        self._threads = [threading.Thread(target=each, daemon=True) for each in (self._send_all, self._hear_all)]
        for thread in self._threads:
            thread.start()

    def take(self, seconds: float, message: Message) -> None:
        """Record a message; never waits, and never raises."""
        self._backlog.put(seconds, message)

    def status(self) -> RecorderStatus:
        """Return the present state of the recording."""
        known, now = self._report.status, self._clock.now()
        return RecorderStatus(
            str(self._path),
            now - self._clock.monotonic,
            known.size,
            known.messages,
            known.dropped + self._backlog.dropped,
            _GONE if self._is_broken else known.problem,
        )

    def close(self) -> None:
        """Send the remaining messages and wait until the file is complete. Raise RecordingError for a failure."""
        self._closing.set()
        for thread in self._threads:
            thread.join(_PATIENCE)
        self._end_process()
        if self._is_broken:
            raise RecordingError(f"{self._path}: {_GONE}")
        if self._report.error:
            raise RecordingError(self._report.error)

    # --- on threads ---------------------------------------------------------------------------------------------

    def _send_all(self) -> None:
        while not self._closing.wait(LOOK_EVERY):
            self._send_waiting()
        self._backlog.tell_dropped(self._clock.now())
        self._send_waiting()
        try:
            self._sink.close()
        except OSError:
            self._is_broken = True

    def _send_waiting(self) -> None:
        while batch := self._next_batch():
            if not self._send(self._sink, msgspec.msgpack.encode(batch)):
                return

    def _next_batch(self) -> Batch:
        return [
            (seconds, message.direction, message.data)
            if type(message) is Wire
            else (seconds, TOPICS[type(message)], encode(message))
            for seconds, message in self._backlog.take_some(_MOST_AT_ONCE)
        ]

    def _send(self, sink: IO[bytes], data: bytes) -> bool:
        """Send a block. Return False if the process has ended."""
        try:
            sink.write(LENGTH.pack(len(data)) + data)
            sink.flush()
        except OSError:
            self._is_broken = True
        return not self._is_broken

    def _hear_all(self) -> None:
        while (report := self._next_report()) is not None:
            self._report = report
        if not self._closing.is_set():
            self._is_broken = True

    def _next_report(self) -> ChildReport | None:
        line = self._source.readline()
        return msgspec.json.decode(line, type=ChildReport) if line else None

    def _end_process(self) -> None:
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._is_broken = True
            self._process.kill()
            self._process.wait()
        for pipe in (self._sink, self._source):
            try:
                pipe.close()
            except OSError:
                self._is_broken = True


if __name__ == "__main__":
    main()
