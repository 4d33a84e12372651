"""The threads of one device whose library blocks.

One thread opens the device, reads from it as long as it is open, and closes it; a second one, which lives inside
the first one's life, writes. So a write never waits for a read that waits for the board, and nothing is in use
when it is closed. Reading and writing at the same time is what hidapi (from 0.15 on) and libusb allow; closing during
either is what they do not.

Nobody can break off a call that is stuck in the operating system. Both threads are daemons: such a one is left
behind, and closes the device by itself when the call returns.
"""

from __future__ import annotations

import asyncio
import atexit
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from enum import Enum
from queue import SimpleQueue
from typing import NamedTuple, Protocol, TypeAlias

from servolink.errors import ConnectionLost, OpenError, TransportError
from servolink.escaping import escape
from servolink.transports.base import Receiver
from servolink.transports.lifecycle import StallWatch

_EXIT_LIMIT = 1.0  # seconds that the end of the program waits for a device to be closed


class OpenDevice(Protocol):
    """A device whose calls block; any error a call raises ends the connection."""

    def read(self) -> bytes:
        """Wait for bytes for a quarter of a second at most, and return none if none came."""
        ...

    def pieces(self, frame: bytes) -> Iterable[bytes]:
        """Cut `frame` into what is offered to the device at once."""
        ...

    def write(self, piece: bytes) -> bytes | None:
        """Offer `piece` for a short while; return the rest that was not taken, or None when all was."""
        ...

    def close(self) -> None:
        """Free it; called once, when neither `read` nor `write` is under way."""
        ...


class Device(Protocol):
    """A device that can be opened."""

    def open(self) -> OpenDevice:
        """Open it, or raise OpenError, which says what to do, and leave nothing open."""
        ...


class Stage(Enum):
    """What the owning thread tells of itself."""

    OPENED = "opened"
    ENDED = "ended"  # the last news: the device is closed


News: TypeAlias = "bytes | asyncio.Future[bool] | Exception | Stage"
"""What the device brought, the future of a frame that it took, what went wrong, or a stage."""


class _Frame(NamedTuple):
    data: bytes
    taken: asyncio.Future[bool]


class DeviceThread:
    """Owns a device, and brings its news to the event loop: one wake-up for as much as there is by then."""

    def __init__(self, device: Device, loop: asyncio.AbstractEventLoop, hear: Callable[[Iterator[News]], None]) -> None:
        """Own `device`; `hear` is called on `loop` whenever there is news, with what there is by then, in order."""
        self._device = device
        self._loop = loop
        self._hear = hear
        self._news: deque[News] = deque()
        self._told = False  # whether `_bring` is on its way
        self._frames: SimpleQueue[_Frame | None] = SimpleQueue()
        self._stopping = False
        self._thread = threading.Thread(target=self._own, name="servolink device", daemon=True)
        self.steps = 0
        """How often the device has taken something."""

    def start(self) -> None:
        """Start opening the device."""
        # Python kills daemons at its end, perhaps in the middle of a read, and then hidapi closes what it left open.
        atexit.register(self._end_with_program)
        self._thread.start()

    def send(self, frame: bytes, taken: asyncio.Future[bool]) -> None:
        """Send `frame` after those before it; `taken` comes back as news when the device has it.

        An empty one only tells when the device has those before it.
        """
        self._frames.put(_Frame(frame, taken))

    def stop(self) -> None:
        """Close the device as soon as it lets go, whatever is still unsent; may be called again, from any thread."""
        self._stopping = True
        self._frames.put(None)

    def _own(self) -> None:
        try:
            device = self._device.open()
        except Exception as error:  # noqa: BLE001 - libraries raise what they like
            self._tell(error)
        else:
            self._use(device)
        finally:
            atexit.unregister(self._end_with_program)
            self._tell(Stage.ENDED)

    def _use(self, device: OpenDevice) -> None:
        writer = threading.Thread(target=self._write, args=[device], name="servolink device writer", daemon=True)
        try:
            writer.start()  # fails when the program is ending
            self._tell(Stage.OPENED)
            self._read(device)
        except Exception as error:  # noqa: BLE001 - told before the device is closed, which can take long
            self._tell(error)
        self.stop()
        if writer.is_alive():
            writer.join()
        with suppress(Exception):  # nothing more can be done for a device that fails to close
            device.close()

    def _read(self, device: OpenDevice) -> None:
        read, tell, is_closed = device.read, self._tell, self._loop.is_closed  # bound once: this runs for every chunk
        while not self._stopping and not is_closed():
            if chunk := read():
                tell(chunk)

    def _write(self, device: OpenDevice) -> None:
        try:
            while (frame := self._frames.get()) is not None:
                for piece in device.pieces(frame.data) if frame.data else ():
                    self._write_piece(device, piece)
                if self._stopping:
                    return
                self._tell(frame.taken)
        except Exception as error:  # noqa: BLE001 - see _use
            self._tell(error)

    def _write_piece(self, device: OpenDevice, piece: bytes) -> None:
        rest: bytes | None = piece
        while rest is not None and not self._stopping:
            offered = len(rest)
            rest = device.write(rest)
            self.steps += rest is None or len(rest) < offered

    def _bring(self) -> None:
        self._told = False  # before looking: what comes while we look calls again
        self._hear(self._take())

    def _take(self) -> Iterator[News]:
        news = self._news
        while news:
            yield news.popleft()

    def _tell(self, news: News) -> None:
        self._news.append(news)
        if not self._told:
            self._told = True
            try:
                self._loop.call_soon_threadsafe(self._bring)
            except RuntimeError:  # the loop is closed: nobody wants the device any more
                self.stop()

    def _end_with_program(self) -> None:
        self.stop()
        self._thread.join(_EXIT_LIMIT)


_DRAIN_LIMIT = 0.4  # seconds that close() gives what was sent to leave
_END_LIMIT = 0.5  # seconds that close() then gives the device to let go: a read takes half of it


class DeviceTransport:
    """Sends, receives, notices the end and closes, while the threads of an `DeviceThread` do what blocks."""

    def __init__(self, url: str, device: Device) -> None:
        """Lead to `device`, shown as `url` in errors."""
        self._url = url
        self._device = device
        self._receiver: Receiver | None = None
        self._owner: DeviceThread | None = None
        self._opened: asyncio.Future[None] | None = None
        self._ready = False
        self._closing = False
        self._over = False  # whether the receiver has been told of the end
        self._cause: Exception | None = None
        self._senders: deque[asyncio.Future[bool]] = deque()  # told whether the device took their bytes
        self._idle = asyncio.Event()
        self._freed = asyncio.Event()
        self._watch = StallWatch(lambda: bool(self._senders), self._steps, self._lose)

    @property
    def url(self) -> str:
        """The address it leads to."""
        return self._url

    async def open(self, receiver: Receiver) -> None:
        """Open the device; OpenError says what to do."""
        if self._receiver is not None or self._closing:
            raise OpenError(f"{escape(self.url)}: a transport is opened once; make another")
        loop = asyncio.get_running_loop()
        self._receiver = receiver
        self._opened = loop.create_future()
        self._owner = DeviceThread(self._device, loop, self._hear)
        self._owner.start()
        try:
            await self._opened
        except asyncio.CancelledError:
            self._owner.stop()
            await _within(_END_LIMIT, self._freed)  # who tries again at once would find it in use, by us
            raise

    async def send(self, data: bytes) -> None:
        """Send all of `data`, or raise ConnectionLost."""
        if self._owner is None or not self._ready or self._closing or self._over:
            raise self._lost()
        if not data and not self._senders:
            return
        taken = asyncio.get_running_loop().create_future()
        self._senders.append(taken)
        self._idle.clear()
        self._owner.send(bytes(data), taken)
        self._watch.start()
        if not await taken:
            raise self._lost()

    async def close(self) -> None:
        """Free the device within 1 s; one that is stuck in a call frees itself when that returns."""
        self._closing = True
        if self._owner is None:
            return
        try:
            if self._senders:
                await _within(_DRAIN_LIMIT, self._idle)
            self._owner.stop()
            await _within(_END_LIMIT, self._freed)
        finally:
            self._owner.stop()
            self._fail_opening(OpenError(f"{escape(self.url)}: it was closed while being opened; try again"))
            self._end()

    def _hear(self, everything: Iterator[News]) -> None:
        """Take in what the threads have to tell."""
        chunks: list[bytes] = []
        for news in everything:
            if isinstance(news, bytes):
                chunks.append(news)
            elif isinstance(news, asyncio.Future):
                self._note_taken(news)
            else:
                self._receive(chunks)
                chunks = []
                self._note(news)
        self._receive(chunks)

    def _note(self, news: Exception | Stage) -> None:
        if news is Stage.OPENED:
            self._note_opened()
        elif news is Stage.ENDED:
            self._freed.set()
            self._end()
        elif isinstance(news, Exception) and not self._fail_opening(news):
            self._lose(news)

    def _note_opened(self) -> None:
        if self._opened is not None and not self._opened.done() and not self._closing:
            self._ready = True
            self._opened.set_result(None)

    def _fail_opening(self, error: Exception) -> bool:
        """Tell whoever opens that it failed; False if it is open."""
        if self._opened is not None and not self._opened.done():
            if not isinstance(error, TransportError):
                error = OpenError(f"{escape(self.url)}: cannot open it: {escape(str(error))}")
            self._opened.set_exception(error)
        return not self._ready

    def _note_taken(self, taken: asyncio.Future[bool]) -> None:
        if self._senders and self._senders[0] is taken:
            self._senders.popleft()
            if not taken.done():
                taken.set_result(True)
        if not self._senders:
            self._idle.set()

    def _receive(self, chunks: list[bytes]) -> None:
        """Pass on what came; a receiver that fails ends the connection instead of losing bytes unseen."""
        if not chunks or self._receiver is None or self._over or not self._ready:
            return
        try:
            self._receiver.data(b"".join(chunks))
        except Exception as error:  # noqa: BLE001 - whatever the bug is
            self._lose(error)

    def _lose(self, cause: Exception) -> None:
        """Lose the connection because of `cause`, unless it has ended already."""
        if not self._over:
            self._cause = cause
            self._end()

    def _end(self) -> None:
        """Tell the receiver and whoever waits, once; the device is freed meanwhile."""
        if self._over:
            return
        self._over = True
        if self._owner is not None:
            self._owner.stop()
        self._watch.stop()
        self._idle.set()
        senders, self._senders = self._senders, deque()
        for sender in senders:
            if not sender.done():
                sender.set_result(False)
        if self._receiver is not None and self._ready:
            self._receiver.lost(None if self._cause is None else self._lost())

    def _lost(self) -> ConnectionLost:
        if self._cause is not None:
            why = f"the connection was lost: {escape(str(self._cause))}"
        else:
            why = "it is closed" if self._closing or self._over else "it is not open yet"
        error = ConnectionLost(f"{escape(self.url)}: {why}")
        error.__cause__ = self._cause
        return error

    def _steps(self) -> int:
        return self._owner.steps if self._owner else 0


async def _within(limit: float, event: asyncio.Event) -> None:
    """Wait for `event`, but no longer than `limit` seconds."""
    with suppress(TimeoutError):
        async with asyncio.timeout(limit):
            await event.wait()
