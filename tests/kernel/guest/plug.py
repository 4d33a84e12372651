"""Plugs USB devices of ours into this kernel: a thread serves each, vhci-hcd is the host controller."""

from __future__ import annotations

import asyncio
import itertools
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from servolink.virtual import BoardDriver, VirtualBoard
from tests.lab.usb_board import plugged
from tests.lab.usbip.descriptors import FULL_SPEED
from tests.lab.usbip.device import UsbDevice
from tests.lab.usbip.usbip_server import Attachment, Use

T = TypeVar("T")
LIMIT = 30.0  # seconds after which something that must happen in this slow machine has failed
_CONTROLLER = Path("/sys/devices/platform/vhci_hcd.0")
_DEVICES = Path("/sys/bus/usb/devices")
_FREE = "004"
_numbers = itertools.count(1)


class Plug:
    """A device with a serial number, in and out of the kernel as often as wanted."""

    def __init__(self, use: Use, serial_number: str = "") -> None:
        self.serial_number = serial_number or f"bench-{next(_numbers)}"
        self.device: UsbDevice
        self._use = use
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop
        self._writer: asyncio.StreamWriter

    @property
    def urls(self) -> dict[str, str]:
        return {kind: self.url(kind) for kind in ("serial", "hid", "usb")}

    def url(self, kind: str) -> str:
        return f"serial://{self.tty}" if kind == "serial" else f"{kind}://1209:0001/{self.serial_number}"

    @property
    def tty(self) -> str:
        return f"/dev/{self._node('*:1.0/tty/*')}"

    @property
    def hidraw(self) -> str:
        return f"/dev/{self._node('*:1.2/*/hidraw/*')}"

    @property
    def usbfs(self) -> str:
        folder = self._folder()
        assert folder is not None, f"{self.serial_number} is not plugged in"
        bus, number = (int((folder / name).read_text()) for name in ("busnum", "devnum"))
        return f"/dev/bus/usb/{bus:03}/{number:03}"

    @property
    def present(self) -> bool:
        return self._folder() is not None

    def __enter__(self) -> Self:
        self.plug_in()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.unplug()

    def plug_in(self) -> None:
        """Return when every driver has its part."""
        ours, kernels = socket.socketpair()
        started: Future[None] = Future()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve(ours, started)), name="device")
        self._thread.start()
        started.result(LIMIT)
        with kernels:
            (_CONTROLLER / "attach").write_text(f"{_free_port()} {kernels.fileno()} {0x10001} {FULL_SPEED}")
        until(self._usable, "the device to be usable")

    def pull(self) -> None:
        """Pull it out; programs may not have been told yet."""
        self._loop.call_soon_threadsafe(self._writer.transport.abort)

    def unplug(self) -> None:
        """Return when the kernel has noticed, too."""
        if self._thread is not None:
            with suppress(RuntimeError):  # its loop is closed: it is out already
                self.pull()
            self._thread.join(LIMIT)
            self._thread = None
            until(lambda: not self.present, "the device to be gone")

    def call(self, function: Callable[[], T]) -> T:
        """Run `function` in the device's thread."""
        result: Future[T] = Future()
        self._loop.call_soon_threadsafe(lambda: result.set_result(function()))
        return result.result(LIMIT)

    async def _serve(self, ours: socket.socket, started: Future[None]) -> None:
        self._loop = asyncio.get_running_loop()
        reader, self._writer = await asyncio.open_connection(sock=ours)
        attachment = Attachment(reader, self._writer, self.serial_number)
        self.device = attachment.device
        with self._use(self.device):
            started.set_result(None)
            with suppress(OSError, EOFError):
                await attachment.serve()
        self._writer.transport.abort()

    def _folder(self) -> Path | None:
        for file in _DEVICES.glob("*/serial"):
            with suppress(OSError):  # it has just vanished
                if file.read_text().strip() == self.serial_number:
                    return file.parent
        return None

    def _node(self, pattern: str) -> str:
        folder = self._folder()
        assert folder is not None, f"{self.serial_number} is not plugged in"
        (node,) = folder.glob(pattern)
        return node.name

    def _usable(self) -> bool:
        folder = self._folder()
        return (
            folder is not None
            and all(list(folder.glob(pattern)) for pattern in ("*:1.0/tty/tty*", "*:1.2/*/hidraw/hidraw*", "*:1.3"))
            and Path(self.tty).exists()
            and Path(self.hidraw).exists()
        )


def board_use(board: VirtualBoard) -> Use:
    """Let `board` speak through all three functions of a device."""

    @contextmanager
    def use(device: UsbDevice) -> Iterator[None]:
        driver = BoardDriver(board)
        with plugged(board, device):
            yield
        driver.stop()

    return use


def until(condition: Callable[[], bool], wanted: str) -> None:
    """Wait for what other threads or the kernel do."""
    deadline = time.monotonic() + LIMIT
    while not condition():
        assert time.monotonic() < deadline, f"waited {LIMIT:g} s for {wanted}"
        time.sleep(0.005)  # the kernel tells nobody when its files change


def _free_port() -> int:
    for line in (_CONTROLLER / "status").read_text().splitlines()[1:]:
        speed, port, state, *_ = line.split()
        if (speed, state) == ("hs", _FREE):
            return int(port)
    raise AssertionError("all ports of vhci-hcd are in use")
