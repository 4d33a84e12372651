"""RecordingWriter: messages to a file, on a separate thread."""

from __future__ import annotations

import os
import threading
from pathlib import Path

from msgspec import Struct

from servolink.errors import RecordingError
from servolink.protocol import Codec
from servolink.recorder.backlog import Backlog, Timed
from servolink.recorder.channels import TOPICS, WIRE_ONLY, Message, ProblemFound, Recorded, Wire, decode, encode
from servolink.recorder.clock import Clock
from servolink.recorder.mcap_stream import McapStream
from servolink.recorder.packet_messages import PacketStream
from servolink.recorder.recording_file import Disk, RecordingFile

CHUNK_SECONDS = 0.8
"""Seconds after which a chunk is written; with `LOOK_EVERY` and the disk, a crash loses at most a second."""
CHUNK_BYTES = 256 * 1024
"""Limit of a chunk in bytes, before the compression."""
LOOK_EVERY = 0.1
"""Seconds: waking the thread for each message would cost the program more than the message."""
_WITH_PACKETS = {"/wire", "/problems"}
_PATIENCE = 1.0  # seconds of waiting, when closing, for a disk that refuses data


class Saved(Struct, frozen=True):
    """File written from a ring, with the reason."""

    path: str
    reason: str
    size: int


class RecorderStatus(Struct, frozen=True):
    """State of a recording under way."""

    path: str
    seconds: float
    """Seconds since the start; for a ring, since the oldest kept message."""
    size: int
    """Bytes on the disk; for a ring, in memory."""
    messages: int
    dropped: int
    """Number of messages missing, because the disk was too slow or full."""
    problem: str
    """Present fault of the disk; empty without a fault."""
    saved: tuple[Saved, ...] = ()
    """Files written from a ring so far."""


class MessageEncoder:
    """Turns messages into the bytes of an MCAP file; packets are derived from the wire bytes here."""

    def __init__(self, about: Recorded, clock: Clock) -> None:
        """Begin a file. Raise RecordingError, with the remedy, if a library is missing."""
        self.stream = McapStream(about)
        self._clock = clock
        codec = Codec(about.byte_order, about.caption_encoding)  # type: ignore[arg-type]  # Codec checks it
        self._packets = None if about.channels == WIRE_ONLY else PacketStream(codec)

    def add(self, timed: Timed) -> None:
        """Add a message, and the packets inside."""
        message = timed.message
        time = self._clock.wall(timed.seconds)
        self.stream.add(TOPICS[type(message)], time, encode(message))
        if self._packets is not None:
            self._add_packets(self._packets, time, message)

    def add_encoded(self, seconds: float, topic: str, data: bytes) -> None:
        """Add an already encoded message, and the packets inside."""
        time = self._clock.wall(seconds)
        self.stream.add(topic, time, data)
        if self._packets is not None and topic in _WITH_PACKETS:
            self._add_packets(self._packets, time, decode(topic, data))

    def _add_packets(self, packets: PacketStream, time: int, message: Message) -> None:
        if isinstance(message, Wire):
            for found in packets.feed(message):
                self.stream.add(TOPICS[type(found)], time, encode(found))
        elif isinstance(message, ProblemFound) and message.channel == "/wire":
            packets.start_over()


class RecordingWriter:
    """Writes a recording; the conversation with the board never waits for the writer."""

    def __init__(
        self,
        path: Path,
        about: Recorded,
        clock: Clock,
        *,
        backlog: Backlog | None = None,
        disk: Disk = os,
    ) -> None:
        """Create the file and begin. Raise RecordingError, with the remedy."""
        self._clock = clock
        self._backlog = backlog or Backlog()
        self._encoder = MessageEncoder(about, clock)
        self._file = RecordingFile(path, disk=disk)
        self._file.put(self._encoder.stream.head())
        self._chunk_began = clock.now()
        self._closing = threading.Event()
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name=f"recorder of {path.name}", daemon=True)
        self._thread.start()

    def take(self, seconds: float, message: Message) -> None:
        """Record a message; never waits, and never raises."""
        self._backlog.put(seconds, message)

    def status(self) -> RecorderStatus:
        """Return the state of the recording."""
        file, backlog = self._file, self._backlog
        seconds = self._clock.now() - self._clock.monotonic
        problem = str(self._failure) if self._failure else file.problem
        return RecorderStatus(
            str(file.path), seconds, file.size, self._encoder.stream.messages, backlog.dropped, problem
        )

    def close(self) -> None:
        """Write the rest and the end of the file, waiting for the disk.

        Raise RecordingError if impossible: whole chunks written before stay readable.
        """
        self._closing.set()
        self._thread.join()
        if self._failure is not None:
            raise RecordingError(f"{self._file.path}: the recording has failed: {self._failure}") from self._failure
        if self._file.problem:
            raise RecordingError(
                f"{self._file.path} is not complete: {self._file.problem}; earlier chunks are readable"
            )

    # --- on the thread ------------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            while not self._closing.wait(LOOK_EVERY):
                if self._file.retry():
                    self._drain()
                    self._write_chunk_if_due()
            self._finish()
        except Exception as error:  # noqa: BLE001 - a defect of ours, which `close` raises
            self._failure = error
        finally:
            self._file.close()

    def _drain(self) -> None:
        """Take waiting messages, and write full chunks."""
        stream = self._encoder.stream
        while (timed := self._backlog.take()) is not None:
            self._encoder.add(timed)
            if stream.waiting >= CHUNK_BYTES and not self._write_chunk():
                return

    def _write_chunk_if_due(self) -> None:
        if self._clock.now() - self._chunk_began >= CHUNK_SECONDS:
            self._write_chunk()

    def _write_chunk(self) -> bool:
        self._chunk_began = self._clock.now()
        chunk = self._encoder.stream.chunk()
        return not chunk or self._file.put(chunk)

    def _finish(self) -> None:
        begun = self._clock.now()
        while not self._file.retry():
            if self._clock.now() - begun >= _PATIENCE:
                return
            threading.Event().wait(LOOK_EVERY)
        self._backlog.tell_dropped(self._clock.now())
        self._drain()
        if self._file.problem:
            return
        if self._write_chunk():
            self._file.put(self._encoder.stream.end())
