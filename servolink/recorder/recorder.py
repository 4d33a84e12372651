"""`record`: everything that passes between programs and a board, written to a file."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager, nullcontext
from importlib.metadata import version
from pathlib import Path
from typing import Any

from msgspec import Struct
from msgspec.structs import force_setattr

from servolink.boards import hub_of, resolve_board
from servolink.client import Alarm, Board, ServoReadings, connect
from servolink.errors import RecordingError, quote
from servolink.recorder.backlog import Backlog
from servolink.recorder.board_source import BoardTap, following
from servolink.recorder.channels import WIRE_ONLY, Event, Message, ProblemFound, Recorded, Wire
from servolink.recorder.clock import Clock
from servolink.recorder.hub_source import tapping
from servolink.recorder.readings import ReadingsFeed, Take
from servolink.recorder.ring import RingWriter, trigger
from servolink.recorder.writer import RecorderStatus, RecordingWriter
from servolink.support import as_number, is_number
from servolink.transports import Address

HZ = 20.0
"""Default number of servo readings per second."""
_SHARED = "share://"
_LONGEST_MARK = 200  # characters


class Wanted(Struct, frozen=True):
    """Settings of a recording. Raise TypeError or ValueError for a wrong option."""

    path: Path
    hz: float = HZ
    """Servo readings requested by the recorder, per second; 0: none."""
    wire_only: bool = False
    """Record bytes only, and ask the board for nothing."""
    alarms: tuple[Alarm, ...] = ()
    ring: float | None = None
    """Seconds to keep in memory, written to a file after a failure; None: write everything."""

    def __post_init__(self) -> None:
        """Check the rate of servo readings."""
        force_setattr(self, "hz", as_number(self.hz))
        if not is_number(self.hz):
            raise TypeError(f"hz must be a number of readings per second, not {quote(self.hz)}")
        if not 0 <= self.hz <= ServoReadings.MOST_HZ:
            raise ValueError(f"hz must be from 0 to {ServoReadings.MOST_HZ:g}, not {quote(self.hz)}")

    @property
    def rate(self) -> float:
        """Number of readings requested per second."""
        return 0.0 if self.wire_only else self.hz


class Recorder:
    """A recording that is under way."""

    def __init__(self, wanted: Wanted) -> None:
        """Collect messages until `begin` starts the writing."""
        self.wanted = wanted
        self.clock = Clock(asyncio.get_running_loop().time)
        self.backlog = Backlog()
        self.take: Take = self._take_wire if wanted.wire_only else self.backlog.put
        """Records a message, and never waits."""
        self.over = asyncio.Event()
        """Set when the hub has ended, so that no message can follow."""
        self._writer: RecordingWriter | RingWriter | None = None

    def _take_wire(self, seconds: float, message: Message) -> None:
        """Record bytes and problems; any other message may only trigger the ring."""
        if isinstance(message, Wire | ProblemFound):
            self.backlog.put(seconds, message)
        elif isinstance(self._writer, RingWriter) and (reason := trigger(message)):
            self._writer.fail(reason)

    def mark(self, text: str, *, who: str = "") -> None:
        """Record an event `mark` with this text, to find the moment again."""
        self.take(self.clock.now(), Event("mark", text[:_LONGEST_MARK], who=who))

    def begin(self, about: Recorded) -> None:
        """Write to a new file from now on, on a thread, collected messages first. Raise RecordingError."""
        wanted = self.wanted
        if wanted.ring is None:
            self._writer = RecordingWriter(wanted.path, about, self.clock, backlog=self.backlog)
        else:
            self._writer = RingWriter(wanted.path, about, self.clock, wanted.ring, backlog=self.backlog)

    def save(self, reason: str) -> None:
        """Write the messages kept by a ring soon; no effect for a recording without a ring."""
        if isinstance(self._writer, RingWriter):
            self._writer.save(reason)

    @property
    def status(self) -> RecorderStatus:
        """State of the recording: size, messages, omissions and faults."""
        assert self._writer is not None  # noqa: S101 - it has begun
        return self._writer.status()

    async def end(self) -> None:
        """Write the rest and the end of the file. Raise RecordingError if impossible."""
        if self._writer is not None:
            await asyncio.to_thread(self._writer.close)

    def about(self, board: str, through: str, byte_order: str, caption_encoding: str) -> Recorded:
        """Return the metadata of the recording."""
        return Recorded(
            version=version("servolink"),
            started=self.clock.started,
            board=board,
            through="hub" if through == "hub" else "board",
            byte_order=byte_order,
            caption_encoding=caption_encoding,
            hz=f"{self.wanted.rate:g}",
            channels=WIRE_ONLY if self.wanted.wire_only else "all",
        )


@asynccontextmanager
async def record(
    path: str | os.PathLike[str], board: Board, *, hz: float = HZ, wire_only: bool = False
) -> AsyncIterator[Recorder]:
    """Record everything that passes between programs and `board` to a new MCAP file, until the block ends.

    At a hub, the commands of all programs are recorded. A thread writes the file, and the program never waits for it:
    messages too many for a slow disk are dropped, counted, and reported in the file. If the program crashes, the last
    second is lost; `open_recording` reads the rest, and `servolink record --repair` mends the file for other programs.

    Args:
        path: File to create.
        board: Connected board.
        hz: Readings of the servos per second, 0 to 1000, shared with all watchers of the servos. With 0, the recorder
            adds no packet to those of the programs.
        wire_only: Whether to record bytes only.

    Raises:
        RecordingError: The file exists or cannot be written; the text names the remedy.
    """
    if not isinstance(board, Board):
        raise TypeError(
            f"board must be a connected board, not {type(board).__name__}; "
            "servolink.sync.record records a board of servolink.sync"
        )
    recorder = Recorder(Wanted(Path(path), hz, wire_only))
    url = board.url
    if url.startswith(_SHARED):
        async with _recording_hub(Address.parse(url).host, recorder):
            yield recorder
        return
    end_tap = board.connection.taps.add(BoardTap(recorder.take))
    try:
        async with _recording_board(board, recorder):
            yield recorder
    finally:
        end_tap()


@asynccontextmanager
async def record_at(
    url: str,
    wanted: Wanted,
    *,
    around: Callable[[Board], AbstractAsyncContextManager[None]] = lambda board: nullcontext(),
    **options: Any,
) -> AsyncIterator[Recorder]:
    """Record the board at an address: beside other programs at a hub, else exclusively and from the first byte on.

    A board without a hub is recorded inside the context `around` it. `options` are the options of `connect`. Raise
    OpenError, and RecordingError, naming the remedy.
    """
    if wanted.ring is None and wanted.path.exists():  # or a board would be opened for nothing
        raise RecordingError(f"{wanted.path} exists already; remove it or record to another file")
    address = (await resolve_board(url)).url
    hub = None if address.startswith(_SHARED) else await asyncio.to_thread(hub_of, address)
    shared = address if hub is None else hub.url
    recorder = Recorder(wanted)
    if shared.startswith(_SHARED):
        async with _recording_hub(Address.parse(shared).host, recorder):
            yield recorder
        return
    connecting = connect(url, reconnect=True, angle_unit=None, **options)
    connecting.taps.add(BoardTap(recorder.take))
    async with connecting as board, around(board), _recording_board(board, recorder):
        yield recorder


@asynccontextmanager
async def _recording_board(board: Board, recorder: Recorder) -> AsyncIterator[None]:
    """Write the messages of a tap on `board` in this context."""
    name = board.profile.name if board.profile is not None else None
    wanted, codec = recorder.wanted, board.codec
    about = recorder.about(name or board.url, "board", codec.byte_order, codec.caption_encoding)
    await asyncio.to_thread(recorder.begin, about)
    try:
        async with following(board, recorder.take, ReadingsFeed(recorder.take, wanted.rate, wanted.alarms)):
            yield
    finally:
        await recorder.end()


@asynccontextmanager
async def _recording_hub(name: str, recorder: Recorder) -> AsyncIterator[None]:
    """Write the messages of the hub `name` in this context."""
    wanted = recorder.wanted
    async with tapping(name, wire_only=wanted.wire_only) as source:
        tapped = source.tapped
        about = recorder.about(name, "hub", tapped.byte_order, tapped.caption_encoding)
        await asyncio.to_thread(recorder.begin, about)
        try:
            source.ended = recorder.over
            await source.begin(recorder.take, ReadingsFeed(recorder.take, wanted.rate, wanted.alarms))
            yield
        finally:
            await source.end()
            await recorder.end()
