"""Observers of a relay, never awaited by the relay: a thread that learns and shows, and a recording."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

from servolink.errors import RecordingError
from servolink.protocol.frame import ByteOrder
from servolink.recorder.backlog import Backlog
from servolink.recorder.channels import Direction, Event, Recorded, Wire
from servolink.recorder.clock import Clock
from servolink.recorder.mcap_stream import McapStream
from servolink.recorder.writer import RecorderStatus, RecordingWriter
from servolink.spy.learning import Learner, Passed

_MOST_WAITING = 16 * 1024 * 1024  # bytes in the queue; further bytes are only counted


class Watcher:
    """Thread that passes bytes to a learner, and packets to `show`."""

    def __init__(self, learner: Learner, show: Callable[[Passed], object]) -> None:
        self._learner = learner
        self._show = show
        self._waiting: deque[tuple[float, Direction, bytes]] = deque()
        self._put = self._taken = 0  # bytes so far, each counted by one thread
        self._wake = threading.Event()
        self._is_over = False
        self._last = 0.0
        self.overlooked = 0
        """Number of bytes not observed because the queue was full."""
        self.failure: Exception | None = None
        """Reason for the end of observation: a defect of servolink, or an output that is closed."""
        self._thread = threading.Thread(target=self._run, name="spy", daemon=True)
        self._thread.start()

    def take(self, seconds: float, direction: Direction, data: bytes) -> None:
        """Take bytes that passed; never waits."""
        if self._put - self._taken > _MOST_WAITING or self.failure is not None:
            self.overlooked += len(data)
            return
        self._put += len(data)
        self._waiting.append((seconds, direction, data))
        self._wake.set()

    def end(self, patience: float) -> None:
        """Process the rest, for at most `patience` seconds."""
        self._is_over = True
        self._wake.set()
        self._thread.join(patience)

    def _run(self) -> None:
        try:
            while not self._is_over:
                self._wake.wait()
                self._wake.clear()
                self._drain()
            self._drain()
            for passed in self._learner.finish(self._last):
                self._show(passed)
        except Exception as error:  # noqa: BLE001 - the relay goes on without it, and its owner reports it
            self.failure = error

    def _drain(self) -> None:
        while self._waiting:
            seconds, direction, data = self._waiting.popleft()
            self._taken += len(data)
            self._last = seconds
            for passed in self._learner.feed(seconds, direction, data):
                self._show(passed)


class SpyRecording:
    """Recording whose byte order is known only after the first packet; kept in memory until then."""

    def __init__(self, path: Path, board: str, caption_encoding: str, now: Callable[[], float]) -> None:
        """Start. Raise RecordingError if `path` exists or the library for recordings is missing."""
        self._path = path
        self._board, self._caption_encoding = board, caption_encoding
        self._clock = Clock(now)
        self._backlog = Backlog()
        self._writer: RecordingWriter | None = None
        if path.exists():
            raise RecordingError(f"{path} exists already; remove it or record to another file")
        if not path.parent.is_dir():
            raise RecordingError(f"{path}: the folder {path.parent} does not exist; create it first")
        McapStream(self._about("little"))

    @property
    def has_begun(self) -> bool:
        """Whether the file is there."""
        return self._writer is not None

    def take(self, seconds: float, direction: Direction, data: bytes) -> None:
        """Record bytes; never waits."""
        self._backlog.put(seconds, Wire(direction, data, seconds))

    def begin(self, byte_order: ByteOrder) -> None:
        """Create the file, and write to the file from now on. Raise RecordingError. Waits for the disk."""
        self._writer = RecordingWriter(self._path, self._about(byte_order), self._clock, backlog=self._backlog)

    async def end(self, learnt: str) -> RecorderStatus:
        """Add the facts and write the end of the file; return the summary. Raise RecordingError."""
        if self._writer is None:
            await asyncio.to_thread(self.begin, "little")
        assert self._writer is not None  # noqa: S101 - it has begun
        self._backlog.put(self._clock.now(), Event("recorder", "learnt", text=learnt))
        await asyncio.to_thread(self._writer.close)
        return self._writer.status()

    def _about(self, byte_order: ByteOrder) -> Recorded:
        return Recorded(
            version("servolink"), self._clock.started, self._board, "spy", byte_order, self._caption_encoding
        )
