"""LateRecording: recording of bytes whose byte order is known only after some of them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

from servolink.errors import RecordingError
from servolink.protocol import ByteOrder
from servolink.recorder.backlog import Backlog
from servolink.recorder.channels import Direction, Event, Recorded, Wire
from servolink.recorder.clock import Clock
from servolink.recorder.mcap_stream import McapStream
from servolink.recorder.writer import RecorderStatus, RecordingWriter


class LateRecording:
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
