"""`record`: everything that passes between programs and a board, to a file."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

from msgspec import Struct
from msgspec.structs import force_setattr

from servolink.client.alarms import Alarm
from servolink.client.board import Board
from servolink.client.connect import connect
from servolink.client.servo_readings import MOST_HZ
from servolink.discovery.hubs import hub_of
from servolink.discovery.names import resolve_board
from servolink.errors import RecordingError
from servolink.escaping import quote
from servolink.numeric import as_number, is_number
from servolink.recorder.backlog import Backlog
from servolink.recorder.board_source import BoardTap, following
from servolink.recorder.channels import Event, Message, ProblemFound, Recorded, Wire
from servolink.recorder.child import ChildWriter
from servolink.recorder.clock import Clock
from servolink.recorder.hub_source import tapping
from servolink.recorder.readings import ReadingsFeed, Take
from servolink.recorder.ring import RingWriter, trigger
from servolink.recorder.writer import RecorderStatus, RecordingWriter
from servolink.transports.address import Address

HZ = 20.0
"""Readings of the servos a second, unless told otherwise."""
_SHARED = "share://"
_LONGEST_MARK = 200  # characters


class Wanted(Struct, frozen=True):
    """What to record. Raise TypeError or ValueError for an option that is wrong."""

    path: Path
    hz: float = HZ
    """Readings of the servos that the recorder asks for, a second; 0: none."""
    wire_only: bool = False
    """Record bytes only, and ask the board for nothing."""
    alarms: tuple[Alarm, ...] = ()
    ring: float | None = None
    """Keep only the last so many seconds, in memory, and write them when something fails; None: write everything."""

    def __post_init__(self) -> None:
        """Check the rate."""
        force_setattr(self, "hz", as_number(self.hz))
        if not is_number(self.hz):
            raise TypeError(f"hz must be a number of readings per second, not {quote(self.hz)}")
        if not 0 <= self.hz <= MOST_HZ:
            raise ValueError(f"hz must be from 0 to {MOST_HZ:g}, not {quote(self.hz)}")

    @property
    def rate(self) -> float:
        """How many readings are asked for, a second."""
        return 0.0 if self.wire_only else self.hz


class Recorder:
    """A recording under way."""

    def __init__(self, wanted: Wanted) -> None:
        """Collect messages; `begin` writes them."""
        self.wanted = wanted
        self.clock = Clock(asyncio.get_running_loop().time)
        self.backlog = Backlog()
        self.take: Take = self._take_wire if wanted.wire_only else self.backlog.put
        """Records a message, and never waits."""
        self.over = asyncio.Event()
        """Set when the hub is gone, so that no message can follow."""
        self._writer: RecordingWriter | ChildWriter | RingWriter | None = None

    def _take_wire(self, seconds: float, message: Message) -> None:
        """Record bytes and problems; anything else may still say that a ring should be written."""
        if isinstance(message, Wire | ProblemFound):
            self.backlog.put(seconds, message)
        elif isinstance(self._writer, RingWriter) and (reason := trigger(message)):
            self._writer.fail(reason)

    def mark(self, text: str, *, who: str = "") -> None:
        """Record an event `mark` with this text, to find the moment again."""
        self.take(self.clock.now(), Event("mark", text[:_LONGEST_MARK], who=who))

    def begin(self, about: Recorded, *, by_child: bool = False) -> None:
        """Write to a new file from now on, what was collected first. Raise RecordingError.

        A thread writes it, or a process: that takes 0.2 s to start, and takes no time from this one.
        """
        wanted, with_packets = self.wanted, not self.wanted.wire_only
        if wanted.ring is None:
            write_with = ChildWriter if by_child else RecordingWriter
            self._writer = write_with(wanted.path, about, self.clock, with_packets=with_packets, backlog=self.backlog)
        else:
            self._writer = RingWriter(
                wanted.path, about, self.clock, wanted.ring, with_packets=with_packets, backlog=self.backlog
            )

    def save(self, reason: str) -> None:
        """Write what a ring has kept, soon; nothing for a recording without one."""
        if isinstance(self._writer, RingWriter):
            self._writer.save(reason)

    @property
    def status(self) -> RecorderStatus:
        """The state of the recording: size, messages, and what is missing or wrong."""
        assert self._writer is not None  # noqa: S101 - it has begun
        return self._writer.status()

    async def end(self) -> None:
        """Write what is left, and the end of the file. Raise RecordingError if that is impossible."""
        if self._writer is not None:
            await asyncio.to_thread(self._writer.close)

    def about(self, board: str, through: str, byte_order: str, caption_encoding: str) -> Recorded:
        """Return the metadata of this recording."""
        return Recorded(
            version=version("servolink"),
            started=self.clock.started,
            board=board,
            through="hub" if through == "hub" else "board",
            byte_order=byte_order,
            caption_encoding=caption_encoding,
            hz=f"{self.wanted.rate:g}",
            channels="wire" if self.wanted.wire_only else "all",
        )


@asynccontextmanager
async def record(
    path: str | os.PathLike[str], board: Board, *, hz: float = HZ, wire_only: bool = False
) -> AsyncIterator[Recorder]:
    """Record everything that passes between programs and `board` to a new MCAP file, until the block ends.

    Of a board that a hub shares, this is what all its programs do. The servos are read `hz` times a second (0..1000; 0:
    never, then nothing is added to what programs send), in common with whoever watches them. With `wire_only` only
    bytes are recorded. The file is written by a process of its own, and nothing here waits for it: what a slow disk
    cannot take is dropped, counted, and noted in the file. If this program crashes, the file is complete up to then.

    Raise RecordingError, which says what to do, if the file exists or cannot be written.
    """
    if not isinstance(board, Board):
        raise TypeError(
            f"board must be a connected board, not {type(board).__name__}; "
            "servolink.sync.record records a board of servolink.sync"
        )
    recorder = Recorder(Wanted(Path(path), hz, wire_only))
    url = board.url
    if url.startswith(_SHARED):
        async with _recording_hub(Address.parse(url).host, recorder, by_child=True):
            yield recorder
        return
    end_tap = board.connection.taps.add(BoardTap(recorder.take))
    try:
        async with _recording_board(board, recorder, by_child=True):
            yield recorder
    finally:
        end_tap()


@asynccontextmanager
async def record_at(url: str, wanted: Wanted, **options: Any) -> AsyncIterator[Recorder]:
    """Record the board at an address: beside other programs if a hub shares it, else alone and from the first byte on.

    `options` are those of `connect`. Raise OpenError, and RecordingError, which say what to do.
    """
    if wanted.ring is None and wanted.path.exists():  # or a board would be opened for nothing
        raise RecordingError(f"{wanted.path} exists already; remove it or record to another file")
    address, _ = await resolve_board(url)
    hub = None if address.startswith(_SHARED) else await asyncio.to_thread(hub_of, address)
    shared = address if hub is None else hub.url
    recorder = Recorder(wanted)
    if shared.startswith(_SHARED):
        async with _recording_hub(Address.parse(shared).host, recorder, by_child=False):
            yield recorder
        return
    connecting = connect(url, reconnect=True, angle_unit=None, **options)
    connecting.taps.add(BoardTap(recorder.take))
    async with connecting as board, _recording_board(board, recorder, by_child=False):
        yield recorder


@asynccontextmanager
async def _recording_board(board: Board, recorder: Recorder, *, by_child: bool) -> AsyncIterator[None]:
    """Write what a tap on `board` hears, in this context."""
    name = board.profile.name if board.profile is not None else None
    wanted, codec = recorder.wanted, board.codec
    about = recorder.about(name or board.url, "board", codec.byte_order, codec.caption_encoding)
    await asyncio.to_thread(recorder.begin, about, by_child=by_child)
    try:
        async with following(board, recorder.take, ReadingsFeed(recorder.take, wanted.rate, wanted.alarms)):
            yield
    finally:
        await recorder.end()


@asynccontextmanager
async def _recording_hub(name: str, recorder: Recorder, *, by_child: bool) -> AsyncIterator[None]:
    """Write what the hub `name` hears, in this context."""
    wanted = recorder.wanted
    async with tapping(name, wire_only=wanted.wire_only) as source:
        tapped = source.tapped
        about = recorder.about(name, "hub", tapped.byte_order, tapped.caption_encoding)
        await asyncio.to_thread(recorder.begin, about, by_child=by_child)
        try:
            source.ended = recorder.over
            await source.begin(recorder.take, ReadingsFeed(recorder.take, wanted.rate, wanted.alarms))
            yield
        finally:
            await source.end()
            await recorder.end()
