"""HubRecorder: recording started and stopped by a page, and written by the process of the hub."""

from __future__ import annotations

import asyncio
import os
import shutil
from collections.abc import Awaitable, Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from servolink.client import Board
from servolink.control import ProblemNotice, RecordingNotice
from servolink.errors import RecordingError, ServolinkError
from servolink.hub.engine.tap import HubTap
from servolink.hub.hub import Hub
from servolink.hub.method_messages import RecordingEntry, RecordingNow
from servolink.recorder import Event, ReadingsFeed, Recorder, RecorderStatus, Wanted
from servolink.support import MIB, user_folder

MOST_BYTES = 1024 * MIB
"""Bytes at which a recording is ended: the starter may have forgotten the recording."""
_LEAST_FREE = 256 * MIB
"""Bytes that must stay free on the disk."""
_SUFFIX = ".mcap"
_LOOK_EVERY = 1.0  # seconds between two checks of size and free space
_PRIVATE = 0o700


class HubRecorder:
    """Recorder of a hub: at most one recording at a time, to a new file in the user's folder of recordings."""

    def __init__(
        self,
        hub: Hub,
        open_board: Callable[[], Awaitable[Board]],
        *,
        folder: Path | None = None,
        most: int = MOST_BYTES,
    ) -> None:
        """Record `hub`; read the servos through `open_board`, with one poll for recorder and watchers."""
        self._hub = hub
        self._open_board = open_board
        self._folder = folder
        self._most = most
        self._recorder: Recorder | None = None
        self._tap: HubTap | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._latest: RecorderStatus | None = None
        self._changing = asyncio.Lock()

    def now(self) -> RecordingNow:
        """Return the state of the present or latest recording."""
        status = self._latest if self._recorder is None else self._recorder.status
        if status is None:
            return RecordingNow(is_recording=False)
        return RecordingNow(
            self._recorder is not None,
            Path(status.path).name,
            status.path,
            round(status.seconds, 3),
            status.size,
            status.messages,
            status.dropped,
            status.problem,
        )

    def folder(self) -> Path:
        """Return the folder of the recordings. Raise OSError for a user without a home."""
        return self._folder or user_folder("data") / "recordings"

    async def start(self, who: str, *, hz: float, wire_only: bool) -> None:
        """Begin to record for `who`. Raise RecordingError if the hub is recording already, or cannot write."""
        async with self._changing:
            if self._recorder is not None:
                raise RecordingError(f"{self._recorder.wanted.path.name} is being recorded already")
            codec = self._hub.board.codec
            recorder = Recorder(Wanted(await asyncio.to_thread(self._new_path), hz, wire_only))
            about = recorder.about(self._hub.name, "hub", codec.byte_order, codec.caption_encoding)
            await asyncio.to_thread(recorder.begin, about)
            self._recorder = recorder
            recorder.take(recorder.clock.now(), Event("connection", self._hub.state))
            self._tap = HubTap(self._hub, recorder.take, wire_only=wire_only)
            follow = [self._watch_over(recorder)]
            if recorder.wanted.rate:
                follow.append(self._follow_servos(recorder))
            self._tasks = [asyncio.create_task(each) for each in follow]
        self._hub.tell(RecordingNotice("started", who, recorder.wanted.path.name))

    async def stop(self, who: str) -> None:
        """End the recording. Raise RecordingError without a recording, or if the end cannot be written."""
        async with self._changing:
            recorder = self._recorder
            if recorder is None:
                raise RecordingError("nothing is being recorded")
            if self._tap is not None:
                self._tap.close()
            tasks, self._tasks = self._tasks, []
            for task in tasks:
                if task is not asyncio.current_task():
                    task.cancel()
            try:
                await recorder.end()
            finally:
                self._latest, self._recorder = recorder.status, None
        self._hub.tell(RecordingNotice("stopped", who, recorder.wanted.path.name))

    def mark(self, text: str, who: str) -> None:
        """Put a mark into the recording. Raise RecordingError if there is none."""
        if self._recorder is None:
            raise RecordingError("nothing is being recorded")
        self._recorder.mark(text, who=who)
        self._hub.tell(RecordingNotice("marked", who, self._recorder.wanted.path.name, text))

    def stored(self) -> list[RecordingEntry]:
        """Return the recordings in the folder, the newest last."""
        found = list[tuple[float, RecordingEntry]]()
        with suppress(OSError), os.scandir(self.folder()) as entries:
            for entry in entries:
                if entry.name.endswith(_SUFFIX) and entry.is_file(follow_symlinks=False):
                    status = entry.stat(follow_symlinks=False)
                    ended = datetime.fromtimestamp(status.st_mtime, UTC).isoformat(timespec="seconds")
                    found.append((status.st_mtime, RecordingEntry(entry.name, status.st_size, ended)))
        return [recording for _, recording in sorted(found)]

    async def close(self) -> None:
        """End the recording, if any: the hub ends."""
        with suppress(RecordingError):
            await self.stop("the hub, which ends")

    def _new_path(self) -> Path:
        """Return the path of a new recording. Raise RecordingError without a folder."""
        try:
            folder = self.folder()
            folder.mkdir(parents=True, exist_ok=True, mode=_PRIVATE)
        except OSError as error:
            raise RecordingError(f"cannot record: {error}") from error
        stem = f"{self._hub.name}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
        names = (f"{stem}{_SUFFIX}", *(f"{stem}-{number}{_SUFFIX}" for number in range(2, 100)))
        return next(folder / name for name in names if not (folder / name).exists())

    async def _follow_servos(self, recorder: Recorder) -> None:
        readings = ReadingsFeed(recorder.take, recorder.wanted.rate)
        try:
            await readings.follow(await self._open_board())
        except ServolinkError as error:
            readings.failed(error)

    async def _watch_over(self, recorder: Recorder) -> None:
        """End a recording that has grown too large, or leaves too little room on the disk."""
        while True:
            await asyncio.sleep(_LOOK_EVERY)
            status = recorder.status
            free = await asyncio.to_thread(_free, recorder.wanted.path.parent)
            reason = ""
            if status.size >= self._most:
                reason = f"it has {status.size // MIB} MiB"
            elif free < _LEAST_FREE:
                reason = f"the disk has only {free // MIB} MiB left"
            if reason:
                self._hub.tell(ProblemNotice(f"the recording {recorder.wanted.path.name} was ended: {reason}"))
                with suppress(RecordingError):
                    await self.stop("the hub")
                return


def _free(folder: Path) -> int:
    """Return how many bytes are free on the disk of a folder; very many if nobody knows."""
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return MOST_BYTES
