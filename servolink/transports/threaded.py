"""Transport over a device with a blocking library, with two threads for each device.

The first thread opens, reads and closes the device; the second thread writes, and is started and joined by the first.
So a write never waits for a read, and no call is in progress when the device is closed. hidapi (from 0.15 on) and
libusb allow a read and a write at the same time, but no close during either.

A call stuck in the operating system cannot be interrupted. Both threads are daemons: a stuck thread is abandoned, and
closes the device when the call returns.
"""

from __future__ import annotations

import asyncio
import atexit
import threading
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, Iterator
from contextlib import suppress
from enum import Enum
from queue import SimpleQueue
from typing import NamedTuple, Protocol, TypeAlias

from servolink.errors import ConnectionLost
from servolink.transports.lifecycle import BaseTransport

_DRAIN_LIMIT = 0.4  # seconds for sent bytes to leave in close()
_END_LIMIT = 0.5  # seconds for the device to stop after that: a read takes half of the time
_EXIT_LIMIT = 1.0  # seconds to close a device at the end of the program


class OpenDevice(Protocol):
    """Open device with blocking calls; an error in a call ends the connection."""

    def read(self) -> bytes:
        """Return received bytes, or b"" after at most 0.25 s without bytes."""
        ...

    def pieces(self, frame: bytes) -> Iterable[bytes]:
        """Cut `frame` into pieces for one call of `write` each."""
        ...

    def write(self, piece: bytes) -> bytes | None:
        """Offer `piece` for a short time; return the rest to be sent again, None if the device accepted all bytes."""
        ...

    def close(self) -> None:
        """Release the device; called once, when neither `read` nor `write` is in progress."""
        ...


class Device(Protocol):
    """Unopened device, with blocking calls."""

    def open(self) -> OpenDevice:
        """Open the device. For a failure, raise OpenError with the remedy, and leave nothing open."""
        ...


class DeviceState(Enum):
    """State of the device, as reported by the thread."""

    OPENED = "opened"
    CLOSED = "closed"  # always the last report of a thread


News: TypeAlias = "bytes | asyncio.Future[bool] | Exception | DeviceState"
"""Report of the threads: a received chunk, the future of an accepted frame, a failure, or a change of state."""


class _QueuedFrame(NamedTuple):
    data: bytes
    accepted: asyncio.Future[bool]


class DeviceThread:
    """Owner of a device, with its threads. Reports to the event loop are collected: one wake-up for many reports."""

    def __init__(self, device: Device, loop: asyncio.AbstractEventLoop, hear: Callable[[Iterator[News]], None]) -> None:
        """Own `device`; call `hear` on `loop` with all collected reports, in order."""
        self._device = device
        self._loop = loop
        self._hear = hear
        self._news: deque[News] = deque()
        self._is_waking = False  # whether a call of `_report` is scheduled
        self._frames: SimpleQueue[_QueuedFrame | None] = SimpleQueue()
        self._stopping = False
        self._thread = threading.Thread(target=self._own, name="servolink device", daemon=True)
        self.steps = 0
        """Number of calls in which the device accepted bytes."""

    def start(self) -> None:
        """Start opening the device."""
        # At exit Python kills daemon threads, perhaps in the middle of a read, and then hidapi closes the open device.
        atexit.register(self._end_with_program)
        self._thread.start()

    def send(self, frame: bytes, accepted: asyncio.Future[bool]) -> None:
        """Send `frame` after all earlier frames, and report `accepted` when the device has accepted the frame.

        An empty frame is reported when the device has accepted all earlier frames.
        """
        self._frames.put(_QueuedFrame(frame, accepted))

    def stop(self) -> None:
        """Close the device as soon as no call is in progress, and drop unsent frames; callable from any thread."""
        self._stopping = True
        self._frames.put(None)

    def _own(self) -> None:
        try:
            device = self._device.open()
        except Exception as error:  # noqa: BLE001 - libraries raise errors of any kind
            self._post(error)
        else:
            self._use(device)
        finally:
            atexit.unregister(self._end_with_program)
            self._post(DeviceState.CLOSED)

    def _use(self, device: OpenDevice) -> None:
        writer = threading.Thread(target=self._write, args=[device], name="servolink device writer", daemon=True)
        try:
            writer.start()  # fails at the end of the program
            self._post(DeviceState.OPENED)
            self._read(device)
        except Exception as error:  # noqa: BLE001 - reported before closing the device, which can take long
            self._post(error)
        self.stop()
        if writer.is_alive():
            writer.join()
        with suppress(Exception):  # no remedy for a failure to close
            device.close()

    def _read(self, device: OpenDevice) -> None:
        read, post, is_closed = (
            device.read,
            self._post,
            self._loop.is_closed,
        )  # bound once: the loop below runs for every chunk
        while not self._stopping and not is_closed():
            if chunk := read():
                post(chunk)

    def _write(self, device: OpenDevice) -> None:
        try:
            while (frame := self._frames.get()) is not None:
                for piece in device.pieces(frame.data) if frame.data else ():
                    self._write_piece(device, piece)
                if self._stopping:
                    return
                self._post(frame.accepted)
        except Exception as error:  # noqa: BLE001 - see _use
            self._post(error)

    def _write_piece(self, device: OpenDevice, piece: bytes) -> None:
        rest: bytes | None = piece
        while rest is not None and not self._stopping:
            offered = len(rest)
            rest = device.write(rest)
            self.steps += rest is None or len(rest) < offered

    def _report(self) -> None:
        self._is_waking = False  # first: a report posted meanwhile must wake the loop again
        self._hear(self._take())

    def _take(self) -> Iterator[News]:
        news = self._news
        while news:
            yield news.popleft()

    def _post(self, news: News) -> None:
        self._news.append(news)
        if not self._is_waking:
            self._is_waking = True
            try:
                self._loop.call_soon_threadsafe(self._report)
            except RuntimeError:  # the loop is closed, and the device is no longer needed
                self.stop()

    def _end_with_program(self) -> None:
        self.stop()
        self._thread.join(_EXIT_LIMIT)


class DeviceTransport(BaseTransport):
    """Transport over a device with blocking calls, made by the threads of a `DeviceThread`."""

    def __init__(self, url: str, device: Device) -> None:
        """Use `device`; `url` names the transport in errors."""
        super().__init__(url)
        self._device = device
        self._thread: DeviceThread | None = None
        self._opened: asyncio.Future[None] | None = None
        self._freed = asyncio.Event()

    async def _open(self) -> None:
        loop = asyncio.get_running_loop()
        self._opened = loop.create_future()
        self._thread = DeviceThread(self._device, loop, self._hear)
        self._thread.start()
        try:
            await self._opened
        except asyncio.CancelledError:
            self._end(None)
            # Otherwise an immediate new attempt would find the device in use.
            await _within(_END_LIMIT, self._freed)
            raise

    def _send(self, data: bytes) -> Awaitable[None] | None:
        if self._thread is None or not (data or self._senders):
            return None
        accepted = asyncio.get_running_loop().create_future()
        self._thread.send(bytes(data), accepted)
        return self._until_accepted(accepted)

    async def _close(self) -> None:
        if self._thread is None:
            return
        try:
            if self._stage == "closing" and (drained := self._send(b"")):
                with suppress(TimeoutError, ConnectionLost):
                    async with asyncio.timeout(_DRAIN_LIMIT):
                        await drained
            self._thread.stop()
            await _within(_END_LIMIT, self._freed)
        finally:
            if self._opened is not None and not self._opened.done():
                self._opened.set_result(None)  # a thread stuck in opening the device is abandoned

    def _abort(self) -> None:
        if self._thread is not None:
            self._thread.stop()

    def _accepted(self) -> int:
        return self._thread.steps if self._thread else 0

    def _hear(self, everything: Iterator[News]) -> None:
        """Handle the reports of the threads; consecutive chunks are joined and delivered together."""
        chunks: list[bytes] = []
        for news in everything:
            if isinstance(news, bytes):
                chunks.append(news)
            elif isinstance(news, asyncio.Future):
                self._note_accepted(news)
            else:
                self._deliver_all(chunks)
                self._note(news)
        self._deliver_all(chunks)

    def _note(self, news: Exception | DeviceState) -> None:
        is_opening = self._opened is not None and not self._opened.done()
        if news is DeviceState.CLOSED:
            self._freed.set()
            self._end(None)
        elif is_opening and self._opened is not None:
            if isinstance(news, Exception):
                self._opened.set_exception(news)
            else:
                self._opened.set_result(None)
        elif isinstance(news, Exception):
            self._lose(news)

    def _note_accepted(self, accepted: asyncio.Future[bool]) -> None:
        if self._senders and self._senders[0] is accepted:
            self._senders.popleft()
            if not accepted.done():
                accepted.set_result(True)

    def _deliver_all(self, chunks: list[bytes]) -> None:
        if chunks:
            self._deliver(b"".join(chunks))
            chunks.clear()


async def _within(limit: float, event: asyncio.Event) -> None:
    """Wait for `event`, at most `limit` seconds."""
    with suppress(TimeoutError):
        async with asyncio.timeout(limit):
            await event.wait()
