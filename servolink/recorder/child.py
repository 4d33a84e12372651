"""The process that writes a recording for another one: `python -m servolink.recorder.child`.

Decoding packets takes longer than sending them. In a thread of the program that is recorded, it would take that time
from the program; here it does not, and a program that crashes leaves a file with a proper end.

Standard input has an `Order`, then batches of messages, each with its length in front; standard output has a status
as a line of JSON now and then, the last one when the input has ended and the file is written.
"""

from __future__ import annotations

import os
import signal
import struct
import sys
import threading
import time
from pathlib import Path
from typing import BinaryIO, cast

import msgspec
from msgspec import Struct

from servolink.errors import DecodeError, RecordingError
from servolink.recorder.channels import Direction, Recorded, Wire, decode
from servolink.recorder.clock import Clock
from servolink.recorder.writer import RecorderStatus, RecordingWriter

LENGTH = struct.Struct("<I")
Batch = list[tuple[float, str, bytes]]
"""Seconds, topic, and the JSON of each message; for bytes of the line `sent` or `received`, and the bytes."""
_DIRECTIONS = {"sent", "received"}
_STATUS_EVERY = 0.25  # seconds
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


class Report(Struct):
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
        _report(Report(RecorderStatus(order.path, 0.0, 0, 0, 0, ""), str(error)))
        return
    ended = threading.Event()
    telling = threading.Thread(target=_tell, args=(writer, ended), daemon=True)
    _report(Report(writer.status()))
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
    _report(Report(writer.status(), error_text))


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
        _report(Report(writer.status()))


def _report(report: Report) -> None:
    try:
        # Unbuffered: Python would try again at the end to write what nobody reads any more, and say that it cannot.
        os.write(sys.stdout.fileno(), msgspec.json.encode(report) + b"\n")
    except OSError:
        return  # the program has crashed


if __name__ == "__main__":
    main()
