"""A transport over a device whose library blocks: HID and USB bulk differ only in the device."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import suppress

from servolink.errors import ConnectionLost, OpenError, TransportError
from servolink.printable import printable
from servolink.transports.base import Receiver
from servolink.transports.owner import Device, News, Owner, Stage
from servolink.transports.stall import StallWatch

_DRAIN_LIMIT = 0.4  # seconds that close() gives what was sent to leave
_END_LIMIT = 0.5  # seconds that close() then gives the device to let go: a read takes half of it


class DeviceTransport:
    """Sends, receives, notices the end and closes, while the threads of an `Owner` do what blocks."""

    def __init__(self, url: str, device: Device) -> None:
        """Lead to `device`, shown as `url` in errors."""
        self._url = url
        self._device = device
        self._receiver: Receiver | None = None
        self._owner: Owner | None = None
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
            raise OpenError(f"{printable(self.url)}: a transport is opened once; make another")
        loop = asyncio.get_running_loop()
        self._receiver = receiver
        self._opened = loop.create_future()
        self._owner = Owner(self._device, loop, self._hear)
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
            self._fail_opening(OpenError(f"{printable(self.url)}: it was closed while being opened; try again"))
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
                error = OpenError(f"{printable(self.url)}: cannot open it: {printable(str(error))}")
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
            why = f"the connection was lost: {printable(str(self._cause))}"
        else:
            why = "it is closed" if self._closing or self._over else "it is not open yet"
        error = ConnectionLost(f"{printable(self.url)}: {why}")
        error.__cause__ = self._cause
        return error

    def _steps(self) -> int:
        return self._owner.steps if self._owner else 0


async def _within(limit: float, event: asyncio.Event) -> None:
    """Wait for `event`, but no longer than `limit` seconds."""
    with suppress(TimeoutError):
        async with asyncio.timeout(limit):
            await event.wait()
