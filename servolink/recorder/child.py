"""Recording in a process of its own: `python -m servolink.recorder.child` writes what a ChildWriter sends.

Decoding packets takes longer than sending them. In a thread of the program that is recorded, it would take that time
from the program; here it does not, and a program that crashes leaves a file with a proper end.

Standard input has an `Order`, then batches of messages, each with its length in front; standard output has a status
as a line of JSON now and then, the last one when the input has ended and the file is written.
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
_MOST_AT_ONCE = 1000  # messages in a batch: the program waits while they are packed
_PATIENCE = 30.0  # seconds for the process to write what is left
_GONE = "the process that writes it has ended; was it killed?"
_NICE = 5  # the program that is recorded goes first


class Order(Struct):
    """What to write."""

    path: str
    about: Recorded
    monotonic: float
    """When the recording began, on the clock of the messages."""
    wall: int
    """The same in nanoseconds since 1970."""
    with_packets: bool


class ChildReport(Struct):
    """A line of standard output."""

    status: RecorderStatus
    error: str = ""
    """Why the recording has failed; empty if it has not."""


def main() -> None:
    """Write one recording."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program, whose end ends this
    if hasattr(os, "nice"):
        os.nice(_NICE)
    source = sys.stdin.buffer
    first = _read(source)
    if first is None:
        return
    order = msgspec.msgpack.decode(first, type=Order)
    clock = Clock(time.monotonic, wall=order.wall, monotonic=order.monotonic)
    try:
        writer = RecordingWriter(Path(order.path), order.about, clock, with_packets=order.with_packets)
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
    """Return the next batch; None at the end, also in the middle of one: the program has crashed."""
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
        # Unbuffered: Python would try again at the end to write what nobody reads any more, and say that it cannot.
        os.write(sys.stdout.fileno(), msgspec.json.encode(report) + b"\n")
    except OSError:
        return  # the program has crashed


class ChildWriter:
    """Passes a recording on to a process of its own; two threads wait for its pipes."""

    def __init__(
        self, path: Path, about: Recorded, clock: Clock, *, with_packets: bool = True, backlog: Backlog | None = None
    ) -> None:
        """Start the process, and wait until it has created the file. Raise RecordingError, which says what to do."""
        self._path = path
        self._clock = clock
        self._backlog = backlog or Backlog(why="the process that writes the recording is too slow")
        command = (sys.executable, "-m", "servolink.recorder.child")
        try:
            # In a session of its own: Ctrl-C and a closed terminal are for the program, not for what it has recorded.
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
        order = Order(str(path.absolute()), about, clock.monotonic, clock.wall(clock.monotonic), with_packets)
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
        """Return the state of the recording."""
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
        """Send a block; False if the process is gone."""
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
