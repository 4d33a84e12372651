"""Ways to bring what a thread reads to an event loop: ours, and those that are commonly taken."""

from __future__ import annotations

import asyncio
import os
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from typing import ClassVar

from servolink.transports.threaded import DeviceThread, DeviceTransport, News, OpenDevice


class Source(ABC):
    """What a thread reads from."""

    @abstractmethod
    def read(self) -> bytes:
        """Wait for the next chunk, for a while; return none if none came."""


class Burst(Source):
    """Chunks that are all there at once."""

    def __init__(self, chunks: int, chunk: bytes) -> None:
        """Give `chunk` so many times."""
        self._chunks = iter([chunk] * chunks)
        self._over = threading.Event()

    def read(self) -> bytes:
        """Return the next one."""
        if not (chunk := next(self._chunks, b"")):
            self._over.wait(0.01)
        return chunk


class Descriptor(Source):
    """A pipe, whose chunks come when they are written."""

    def __init__(self, descriptor: int) -> None:
        """Read from `descriptor`."""
        self.descriptor = descriptor

    def read(self) -> bytes:
        """Wait in the system."""
        return os.read(self.descriptor, 4096)


class Way(ABC):
    """One way; `hear` is called on the loop with each chunk, or with several that were joined."""

    name: ClassVar[str]

    def __init__(self, source: Source, hear: Callable[[bytes], object]) -> None:
        """Bring what is read from `source` to `hear`."""
        self.source = source
        self.hear = hear

    @abstractmethod
    async def start(self) -> None:
        """Begin."""

    @abstractmethod
    async def stop(self) -> None:
        """End, once the source gives nothing more."""


class NoThread(Way):
    """The event loop itself waits for the descriptor."""

    name = "add_reader, no thread"

    async def start(self) -> None:
        """Watch it."""
        assert isinstance(self.source, Descriptor)  # noqa: S101 - what this way needs
        read, hear = self.source.read, self.hear
        asyncio.get_running_loop().add_reader(self.source.descriptor, lambda: hear(read()))

    async def stop(self) -> None:
        """Watch it no longer."""
        assert isinstance(self.source, Descriptor)  # noqa: S101 - see start
        asyncio.get_running_loop().remove_reader(self.source.descriptor)


class _Device:
    """A device that is only read."""

    def __init__(self, source: Source) -> None:
        self.read = source.read  # no call more than the other ways

    def open(self) -> OpenDevice:
        return self

    def pieces(self, frame: bytes) -> Iterable[bytes]:
        return ()

    def write(self, piece: bytes) -> None:
        raise AssertionError("nothing is sent")

    def close(self) -> None:
        pass


class OurOwner(Way):
    """The thread that owns a device: one wake-up for as much as there is by then."""

    name = "servolink, owner thread"

    async def start(self) -> None:
        """Start it."""
        self._owner = DeviceThread(_Device(self.source), asyncio.get_running_loop(), self._take)
        self._owner.start()

    async def stop(self) -> None:
        """Let it end."""
        self._owner.stop()
        await asyncio.sleep(0.05)

    def _take(self, everything: Iterator[News]) -> None:
        for news in everything:
            if isinstance(news, bytes):
                self.hear(news)


class OurTransport(Way):
    """The whole transport of HID and USB."""

    name = "servolink, whole transport"

    async def start(self) -> None:
        """Open it."""
        self._transport = DeviceTransport("test://device", _Device(self.source))
        await self._transport.open(self)

    async def stop(self) -> None:
        """Close it."""
        await self._transport.close()

    def data(self, chunk: bytes, /) -> None:
        """Take what came."""
        self.hear(chunk)

    def lost(self, error: Exception | None, /) -> None:
        """Take note of the end, which is asked for."""


class EachChunk(Way):
    """A thread that wakes the loop for every chunk."""

    name = "call_soon_threadsafe for each chunk"

    async def start(self) -> None:
        """Start it."""
        self._stopping = False
        loop = asyncio.get_running_loop()

        def bring() -> None:
            while not self._stopping:
                if chunk := self.source.read():
                    loop.call_soon_threadsafe(self.hear, chunk)

        self._thread = threading.Thread(target=bring, daemon=True)
        self._thread.start()

    async def stop(self) -> None:
        """Let it end."""
        self._stopping = True
        self._thread.join(1)


class ToThread(Way):
    """A task that has a thread of a pool read each chunk."""

    name = "asyncio.to_thread for each chunk"

    async def start(self) -> None:
        """Start it."""
        self._stopping = False
        self._task = asyncio.create_task(self._bring())

    async def stop(self) -> None:
        """Let it end."""
        self._stopping = True
        await self._task

    async def _bring(self) -> None:
        while not self._stopping:
            if chunk := await asyncio.to_thread(self.source.read):
                self.hear(chunk)


WAYS: tuple[type[Way], ...] = (NoThread, OurOwner, OurTransport, EachChunk, ToThread)
