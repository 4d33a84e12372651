"""The transports on the kernel's real drivers, with the far end of the cable in the test's hand."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

from servolink.transports import Address, HidDevice, PortIdentity, Transport, create, load_hidapi
from tests.kernel.guest.plug import Plug
from tests.lab.usbip.descriptors import PACKET
from tests.lab.usbip.device import Pipe, UsbDevice, reports, transfers
from tests.transports.wires import Ear, Measuring, Wire

_plugs: list[Plug] = []


def _plug() -> Plug:
    """Return a device that is plugged in, the last one if it still is: plugging takes half a second."""
    if not _plugs:
        _plugs.append(Plug(_silent))
        _plugs[0].plug_in()
    return _plugs[0]


@contextmanager
def _silent(_: UsbDevice) -> Iterator[None]:
    yield


def unplug_all() -> None:
    while _plugs:
        _plugs.pop().unplug()


class KernelWire(Wire):
    """A transport through a driver of the kernel; far ends are pipes of a device, which live in its thread."""

    is_buffered = False

    def __init__(self, kind: str) -> None:
        super().__init__()
        self._kind = kind
        self._deaf = False

    async def start(self) -> Transport:
        self._loop = asyncio.get_running_loop()
        self._plug = _plug()
        device = self._plug.device
        self._pipe: Pipe = {"serial": device.serial, "hid": device.hid, "usb": device.bulk}[self._kind]
        self._pipe.receive = self._take
        self._pipe.from_host._ready = lambda: not self._deaf
        return create(self._plug.url(self._kind))

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.transport.close()
        self._deaf = False
        if _plugs:
            self._plug.call(self._forget)

    async def say(self, data: bytes) -> None:
        self._plug.call(lambda: self._pipe.to_host.send(self._packets(data)))

    async def vanish(self) -> None:
        unplug_all()

    def deafen(self) -> None:
        self._deaf = True

    def listen(self) -> None:
        self._deaf = False
        self._plug.call(self._pipe.from_host.advance)

    def _take(self, data: bytes) -> None:
        self._loop.call_soon_threadsafe(self.far.data, data)

    def _packets(self, data: bytes) -> list[bytes]:
        return transfers(data)

    def _forget(self) -> None:
        self._pipe.receive = lambda _: None
        self._pipe.from_host.advance()
        self._pipe.to_host._packets.clear()
        self._pipe.to_host.waiting = 0


class KernelHidWire(KernelWire):
    """The HID transport; its reports are filled up, which the contract knows nothing of."""

    def __init__(self) -> None:
        super().__init__("hid")
        self.ear = self._ear = TrimmingEar()

    async def start(self) -> Transport:
        await super().start()
        url = self._plug.url("hid")
        return Measuring(url, HidDevice(load_hidapi(), url, PortIdentity.from_address(Address.parse(url))))

    async def say(self, data: bytes) -> None:
        self._ear.lengths.append(len(data))
        await super().say(data)

    def _take(self, data: bytes) -> None:
        assert isinstance(self.transport, Measuring)
        super()._take(trimmed(data, self.transport.lengths))

    def _packets(self, data: bytes) -> list[bytes]:
        return reports(data)


class TrimmingEar(Ear):
    """Hears reports without what they are filled up with."""

    def __init__(self) -> None:
        super().__init__()
        self.lengths: deque[int] = deque()

    def data(self, chunk: bytes, /) -> None:
        for start in range(0, len(chunk), PACKET):
            super().data(trimmed(chunk[start : start + PACKET], self.lengths))


def trimmed(report: bytes, lengths: deque[int]) -> bytes:
    """Return what `report` carries of the first of the frames with `lengths`, and take it off them."""
    assert len(report) == PACKET
    size, lengths[0] = min(PACKET, lengths[0]), max(0, lengths[0] - PACKET)
    assert not any(report[size:])
    if not lengths[0]:
        lengths.popleft()
    return report[:size]
