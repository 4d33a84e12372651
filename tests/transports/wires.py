"""Transports with their far end in the test's hand, for the contract every transport must keep.

A new kind of transport joins the contract as one more entry of `WIRES`.
"""

from __future__ import annotations

import asyncio
import functools
import os
import socket
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Coroutine
from pathlib import Path
from types import TracebackType
from typing import Any, ParamSpec, Self, cast

import msgspec
import serial.rfc2217  # type: ignore[import-untyped]

from servolink.control import Greeting, Welcome
from servolink.support import socket_folder, socket_path, user_folder
from servolink.transports.base import Transport
from servolink.transports.device_info import PortIdentity
from servolink.transports.hid import HidDevice
from servolink.transports.line_faults import Faults, FaultyTransport
from servolink.transports.line_recording import RecordingTransport
from servolink.transports.memory import MemoryTransport
from servolink.transports.page_ports import PagePort, PagePorts
from servolink.transports.registry import create
from servolink.transports.threaded import Device, DeviceTransport
from servolink.transports.usb import BulkDevice
from tests.transports.fake_hid import KERNEL_QUEUE, FakeHid
from tests.transports.fake_usb import PACKET, FakeUsb

P = ParamSpec("P")
FLOOD = 1_000_000  # bytes: more than any system takes while the far end does not read
LIMIT = 120.0  # seconds after which a test of real I/O has failed


def on_loop(test: Callable[P, Coroutine[Any, Any, None]]) -> Callable[P, None]:
    """Run a coroutine test on a loop of its own, and fail if it hangs or leaves a task behind."""

    @functools.wraps(test)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        async def guarded() -> None:
            async with asyncio.timeout(LIMIT):
                await test(*args, **kwargs)
            await asyncio.sleep(0)
            left = asyncio.all_tasks() - {asyncio.current_task()}
            assert not left, f"tasks left behind: {left}"

        asyncio.run(guarded())

    return run


class Ear:
    """A receiver that remembers."""

    def __init__(self) -> None:
        self._heard = bytearray()
        self.losses: list[Exception | None] = []
        self.threads: set[int] = set()
        self._news = asyncio.Event()

    def data(self, chunk: bytes, /) -> None:
        assert not self.losses, "data after the end"
        self.threads.add(threading.get_ident())
        self._heard += chunk
        self._news.set()

    def lost(self, error: Exception | None, /) -> None:
        self.threads.add(threading.get_ident())
        self.losses.append(error)
        self._news.set()

    @property
    def heard(self) -> bytes:
        return bytes(self._heard)

    async def hear(self, size: int) -> bytes:
        while len(self._heard) < size:
            await self._next()
        return self.heard

    async def end(self) -> Exception | None:
        while not self.losses:
            await self._next()
        return self.losses[0]

    async def _next(self) -> None:
        self._news.clear()
        await self._news.wait()


class Wire(ABC):
    """A transport, the receiver it is opened with, and the far end."""

    presses_back = True  # whether a far end that does not read makes the sender wait
    flood = FLOOD
    is_buffered = True  # whether the system takes a short frame for a far end that does not read
    transport: Transport

    def __init__(self, wrap: Callable[[Transport], Transport] = lambda inner: inner) -> None:
        self.wrap = wrap
        self.ear = Ear()
        self.far = Ear()

    async def __aenter__(self) -> Self:
        self.transport = self.wrap(await self.start())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.transport.close()
        await self.vanish()

    async def open(self) -> Ear:
        await self.transport.open(self.ear)
        return self.ear

    @abstractmethod
    async def start(self) -> Transport:
        """Set up the far end and make the transport that leads to it."""

    @abstractmethod
    async def say(self, data: bytes) -> None:
        """Send from the far end."""

    @abstractmethod
    async def vanish(self) -> None:
        """Take the far end away; may be called again."""

    @abstractmethod
    def deafen(self) -> None:
        """Make the far end stop reading."""

    @abstractmethod
    def listen(self) -> None:
        """Make the far end read again."""


class PtyWire(Wire):
    """The serial transport on one end of a pseudo-terminal."""

    async def start(self) -> Transport:
        self._loop = asyncio.get_running_loop()
        self._master, self.slave = os.openpty()
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self.slave)
        self._there = True
        # Not before the transport has made the line raw: until then it echoes.
        self.listen()
        return create(self.path)

    async def say(self, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(self._master, data) :]
            except BlockingIOError:
                writable = asyncio.Event()
                self._loop.add_writer(self._master, writable.set)
                await writable.wait()
                self._loop.remove_writer(self._master)

    async def vanish(self) -> None:
        if self._there:
            self._there = False
            self.deafen()
            os.close(self.slave)
            os.close(self._master)

    def deafen(self) -> None:
        self._loop.remove_reader(self._master)

    def listen(self) -> None:
        self._loop.add_reader(self._master, lambda: self.far.data(os.read(self._master, 65536)))


class TcpWire(Wire, asyncio.Protocol):
    """The TCP transport, and a server with a small receive buffer."""

    _connection: asyncio.Transport | None = None

    async def start(self) -> Transport:
        self._accepted = asyncio.Event()
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16384)
        listener.bind(("127.0.0.1", 0))
        self._server = await asyncio.get_running_loop().create_server(lambda: self, sock=listener)
        return create(f"tcp://127.0.0.1:{listener.getsockname()[1]}")

    async def open(self) -> Ear:
        ear = await super().open()
        await self._accepted.wait()
        return ear

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._connection = transport
        self._accepted.set()

    def data_received(self, data: bytes) -> None:
        self.far.data(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self.far.lost(exc)

    async def say(self, data: bytes) -> None:
        assert self._connection is not None
        self._connection.write(data)

    async def vanish(self) -> None:
        if self._connection is not None:
            self._connection.abort()
            await self.far.end()
        self._server.close()
        await self._server.wait_closed()

    def deafen(self) -> None:
        assert self._connection is not None
        self._connection.pause_reading()

    def listen(self) -> None:
        assert self._connection is not None
        self._connection.resume_reading()


class Rfc2217Wire(TcpWire):
    """The transport for RFC 2217, and the server's side of pyserial."""

    async def start(self) -> Transport:
        self.port = serial.serial_for_url("loop://", baudrate=9600)
        return create((await super().start()).url.replace("tcp://", "rfc2217://"))

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self.manager = cast("Any", serial.rfc2217.PortManager)(self.port, self)

    def write(self, data: bytes) -> None:
        """Send what the manager has to say."""
        assert self._connection is not None
        self._connection.write(data)

    def data_received(self, data: bytes) -> None:
        self.far.data(b"".join(self.manager.filter(data)))

    async def say(self, data: bytes) -> None:
        self.write(b"".join(self.manager.escape(data)))


class ShareWire(TcpWire):
    """The share transport, and a hub that says welcome."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name = name
        self._greeting = b""

    async def start(self) -> Transport:
        self._accepted = asyncio.Event()
        listener = socket.socket(socket.AF_UNIX)
        user_folder("runtime").mkdir(mode=0o700, exist_ok=True)
        with socket_folder() as folder:
            self._path = os.path.realpath(folder) + f"/{self._name}.sock"
            listener.bind(socket_path(folder, self._name))
        listener.listen()
        self._server = await asyncio.get_running_loop().create_server(lambda: self, sock=listener)
        return create(f"share://{self._name}")

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._connection = transport
        transport.set_write_buffer_limits(high=0)
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16384)

    def data_received(self, data: bytes) -> None:
        if self._accepted.is_set():
            super().data_received(data)
            return
        self._greeting += data
        if self._greeting.endswith(b"\n"):
            greeting = msgspec.json.decode(self._greeting, type=Greeting)
            welcome = Welcome(servolink=1, session="1", name=self._name, url="virtual://", role=greeting.role)
            assert self._connection is not None
            self._connection.write(msgspec.json.encode(welcome) + b"\n")
            self._accepted.set()

    async def vanish(self) -> None:
        await super().vanish()
        Path(self._path).unlink(missing_ok=True)


class MemoryWire(Wire):
    """One end of a pair, and the other."""

    presses_back = False

    async def start(self) -> Transport:
        near, self._other = MemoryTransport.pair()
        await self._other.open(self.far)
        return near

    async def say(self, data: bytes) -> None:
        await self._other.send(data)

    async def vanish(self) -> None:
        await self._other.close()

    def deafen(self) -> None:
        """Memory always takes all."""

    def listen(self) -> None:
        """Memory always takes all."""


def hear_in(loop: asyncio.AbstractEventLoop, ear: Ear, data: bytes) -> None:
    """Pass `data` from another thread to `ear` and wait until it is heard, as a board takes one report at a time."""
    heard = threading.Event()

    def hear() -> None:
        ear.data(data)
        heard.set()

    loop.call_soon_threadsafe(hear)
    heard.wait(LIMIT)


class HidWire(Wire):
    """The HID transport, and a board where hidapi would find one."""

    is_buffered = False
    flood = 100_000  # in reports of 64 bytes, each of which takes its time

    def __init__(self, node: Path) -> None:
        super().__init__()
        self.hid = FakeHid(node)

    async def start(self) -> Transport:
        self._loop = asyncio.get_running_loop()
        self.hid.heard = self._take
        return Measuring("hid://1209:0001", HidDevice(self.hid, "hid://1209:0001", PortIdentity()))

    async def say(self, data: bytes) -> None:
        for start in range(0, len(data), 64):
            while len(self.hid.reports) >= KERNEL_QUEUE:  # a board sends when it is asked, a report each millisecond
                await asyncio.sleep(0.001)
            self.hid.bring(data[start : start + 64])

    async def vanish(self) -> None:
        self.hid.unplug()

    def deafen(self) -> None:
        self.hid.set(deaf=True)

    def listen(self) -> None:
        self.hid.set(deaf=False)

    def _take(self, report: bytes) -> None:
        """Hear a report without its padding, which is not part of the contract."""
        assert isinstance(self.transport, Measuring)
        assert report[0] == 0
        assert len(report) == 65
        wanted = self.transport.lengths
        data, wanted[0] = report[1 : 1 + min(64, wanted[0])], max(0, wanted[0] - 64)
        assert not any(report[1 + len(data) :])
        if not wanted[0]:
            wanted.popleft()
        hear_in(self._loop, self.far, data)


class Measuring(DeviceTransport):
    """Notes the length of each frame."""

    def __init__(self, url: str, device: Device) -> None:
        super().__init__(url, device)
        self.lengths: deque[int] = deque()

    async def send(self, data: bytes) -> None:
        if data:
            self.lengths.append(len(data))
        await super().send(data)


class UsbWire(Wire):
    """The USB transport under the real pyusb, and a board where libusb would find one."""

    is_buffered = False

    async def start(self) -> Transport:
        self.usb = FakeUsb()
        self.usb.heard = functools.partial(hear_in, asyncio.get_running_loop(), self.far)
        return DeviceTransport("usb://1209:0001", BulkDevice("usb://1209:0001", PortIdentity(), library=self.usb))

    async def say(self, data: bytes) -> None:
        self.usb.bring(*(data[start : start + PACKET] for start in range(0, len(data) + 1, PACKET)))

    async def vanish(self) -> None:
        self.usb.unplug()

    def deafen(self) -> None:
        self.usb.set(deaf=True)

    def listen(self) -> None:
        self.usb.set(deaf=False)


class PageWire(Wire):
    """The port of a page, and a stand-in of the page, whose browser takes pieces one after the other."""

    piece = 4096

    async def start(self) -> Transport:
        self.posted: list[tuple[str, str]] = []
        self._number = self._sent = 0
        self._unsent = bytearray()
        self._is_deaf = self._is_lost = False
        self._page = PagePorts(self._take, PlainFrames(), lambda: None)
        return PagePort("webserial://1a86:7523", self._page, {})

    def _take(self, kind: str, number: int, text: str) -> None:
        self.posted.append((kind, text))
        self._number = number
        match kind:
            case "port.open":
                self.tell("port.opened", "0")
            case "port.frame":
                self._unsent += text.partition(" ")[2].encode("latin-1")
                self._soon(self._write)
            case "port.close":
                self.tell("port.closed")

    def _write(self) -> None:
        if self._unsent and not self._is_deaf and not self._is_lost:
            data, self._unsent = bytes(self._unsent[: self.piece]), self._unsent[self.piece :]
            self._sent += len(data)
            self.far.data(data)
            self.tell("port.sent", str(self._sent))
            self._soon(self._write)

    def _soon(self, act: Callable[[], None]) -> None:
        asyncio.get_running_loop().call_soon(act)

    def tell(self, kind: str, text: str = "") -> None:
        """Post a message of the page, which arrives in a later turn of the loop."""
        asyncio.get_running_loop().call_soon(self._page.take, kind, self._number, text)

    async def say(self, data: bytes) -> None:
        self.tell("port.data", data.decode("latin-1"))

    async def vanish(self) -> None:
        if not self._is_lost:
            self._is_lost = True
            self.tell("port.lost")
            await asyncio.sleep(0)

    def deafen(self) -> None:
        self._is_deaf = True

    def listen(self) -> None:
        self._is_deaf = False
        self._soon(self._write)


class PlainFrames:
    """Frames of which each one with an M moves, and S is the stop."""

    def may_move(self, frame: bytes) -> bool:
        return b"M" in frame

    def stop_for(self, frame: bytes) -> bytes:
        return b"S"


WIRES: dict[str, Callable[[Path], Wire]] = {
    "serial": lambda _: PtyWire(),
    "tcp": lambda _: TcpWire(),
    "rfc2217": lambda _: Rfc2217Wire(),
    "share": lambda _: ShareWire("rex"),
    "memory": lambda _: MemoryWire(),
    "hid": lambda folder: HidWire(folder / "hidraw0"),
    "usb": lambda _: UsbWire(),
    "page": lambda _: PageWire(),
    "faulty": lambda _: TcpWire(lambda inner: FaultyTransport(inner, Faults())),
    "recording": lambda folder: PtyWire(lambda inner: RecordingTransport(inner, _fresh(folder))),
}


def _fresh(folder: Path) -> Path:
    return folder / f"{len(list(folder.iterdir()))}.jsonl"
