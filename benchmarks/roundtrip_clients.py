"""Who asks in the benchmark of round trips: bare system calls, servolink, other libraries."""

from __future__ import annotations

import asyncio
import os
import selectors
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from importlib import import_module
from time import perf_counter_ns
from typing import Any, ClassVar

from benchmarks.answers import answers, exchange
from benchmarks.responder import Answers
from servolink import sync
from servolink.client.connecting import connect
from servolink.protocol.codec import Codec

_BAUDRATE = 115200  # a pseudo-terminal takes no notice of it


class Client(ABC):
    """One way to ask, with what it needs at the other end."""

    name: ClassVar[str]
    package: ClassVar[str] = ""
    """The library that it shows, by the name it is installed by."""

    def __init__(self, size: int) -> None:
        """Ask for answers of `size` bytes, or of about as many as its format allows."""
        query, self.answer = exchange(size)
        self.query: Any = query
        self.frame = Codec().encode(query)
        self.answers: Answers = answers() | {query.packet_id: self.answer}
        """How the other end answers."""

    @abstractmethod
    def open(self, path: str) -> None:
        """Open the port."""

    @abstractmethod
    def ask(self, times: int) -> list[int]:
        """Make round trips, one after the other; return what each took, in nanoseconds."""

    @abstractmethod
    def close(self) -> None:
        """Close the port."""


class Polling(Client):
    """The least that a program which waits for several things at once has to do."""

    name = "os.write, epoll, os.read"

    def open(self, path: str) -> None:
        """Open the port, which does not block."""
        self.port = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self.selector = selectors.DefaultSelector()
        self.selector.register(self.port, selectors.EVENT_READ)

    def ask(self, times: int) -> list[int]:
        """Write, wait, read."""
        port, frame, size, select = self.port, self.frame, len(self.answer), self.selector.select
        took = []
        for _ in range(times):
            began = perf_counter_ns()
            os.write(port, frame)
            came = 0
            while came < size:
                select()
                came += len(os.read(port, 4096))
            took.append(perf_counter_ns() - began)
        return took

    def close(self) -> None:
        """Close it."""
        self.selector.close()
        os.close(self.port)


class LoopClient(Client):
    """One that asks on an event loop of its own."""

    def open(self, path: str) -> None:
        """Open the port on a new loop."""
        self.loop = asyncio.new_event_loop()
        asyncio.set_event_loop(self.loop)
        self.loop.run_until_complete(self.connect(path))

    def ask(self, times: int) -> list[int]:
        """Let the loop run for all of them."""
        asyncio.set_event_loop(self.loop)
        return self.loop.run_until_complete(self._ask(times))

    def close(self) -> None:
        """Close port and loop."""
        asyncio.set_event_loop(self.loop)
        self.loop.run_until_complete(self.disconnect())
        self.loop.close()

    async def _ask(self, times: int) -> list[int]:
        request = self.request()
        took = []
        for _ in range(times):
            began = perf_counter_ns()
            await request()
            took.append(perf_counter_ns() - began)
        return took

    @abstractmethod
    async def connect(self, path: str) -> None:
        """Open the port."""

    @abstractmethod
    def request(self) -> Callable[[], Awaitable[Any]]:
        """Return what makes one round trip."""

    @abstractmethod
    async def disconnect(self) -> None:
        """Close the port."""


class _Counting(LoopClient):
    """One that waits for as many bytes as the answer has, or for a frame, without looking at them any further."""

    _waiter: asyncio.Future[None]
    _came = 0

    def data(self, chunk: bytes) -> None:
        """Count."""
        self._came += len(chunk)
        if self._came >= len(self.answer):
            self._came = 0
            self._waiter.set_result(None)

    def lost(self, error: Exception | None) -> None:
        """Nothing more to do: whoever waits is the benchmark, which then stands still."""


class Bare(_Counting):
    """pyserial-asyncio with a protocol that counts bytes."""

    name = "pyserial-asyncio, bare protocol"
    package = "pyserial-asyncio"

    async def connect(self, path: str) -> None:
        """Open the port."""
        counting = self

        class Protocol(asyncio.Protocol):
            def data_received(self, data: bytes) -> None:
                counting.data(data)

        self.pipe, _ = await import_module("serial_asyncio").create_serial_connection(
            self.loop, Protocol, path, baudrate=_BAUDRATE
        )
        await asyncio.sleep(0.01)  # it begins to read in a later turn of the loop

    def request(self) -> Callable[[], Awaitable[Any]]:
        """Write, wait for the future."""

        async def request() -> None:
            self._waiter = self.loop.create_future()
            self.pipe.write(self.frame)
            await self._waiter

        return request

    async def disconnect(self) -> None:
        """Close it."""
        self.pipe.abort()
        await asyncio.sleep(0.01)


class Ours(LoopClient):
    """`board.request`: encoding, turns, lanes, deadline, matching and decoding."""

    name = "servolink, board.request"

    async def connect(self, path: str) -> None:
        """Open the board."""
        self.board = await connect(path).open()
        await asyncio.sleep(0.01)

    def request(self) -> Callable[[], Awaitable[Any]]:
        """Ask."""
        return lambda: self.board.request(self.query)

    async def disconnect(self) -> None:
        """Close it."""
        await self.board.close()


class OurSync(Client):
    """`board.request` of `servolink.sync`: the same in the thread of its loop, with a thread that waits for it."""

    name = "servolink.sync, board.request"

    def open(self, path: str) -> None:
        """Open the board."""
        self.board = sync.connect(path)

    def ask(self, times: int) -> list[int]:
        """Ask."""
        request, query = self.board.request, self.query
        took = []
        for _ in range(times):
            began = perf_counter_ns()
            request(query)
            took.append(perf_counter_ns() - began)
        return took

    def close(self) -> None:
        """Close it."""
        self.board.close()


class Modbus(LoopClient):
    """pymodbus: holding registers over RTU, 4 of them (13 bytes) or 90 (185)."""

    name = "pymodbus, read_holding_registers"
    package = "pymodbus"

    def __init__(self, size: int) -> None:
        """Ask for as many registers as make an answer of about `size` bytes."""
        super().__init__(size)
        self._count = (size - 5) // 2
        values = import_module("pymodbus.pdu.register_message").ReadHoldingRegistersResponse(
            registers=list(range(self._count)), dev_id=1
        )
        pdu = import_module("pymodbus.pdu").DecodePDU(False)  # noqa: FBT003 - a client's, by position
        self.answer = import_module("pymodbus.framer").FramerRTU(pdu).buildFrame(values)
        self.answers = (8, self.answer)

    async def connect(self, path: str) -> None:
        """Open the port."""
        self._client = import_module("pymodbus.client").AsyncModbusSerialClient(path, baudrate=_BAUDRATE)
        await self._client.connect()

    def request(self) -> Callable[[], Awaitable[Any]]:
        """Ask."""
        return lambda: self._client.read_holding_registers(0, count=self._count, device_id=1)

    async def disconnect(self) -> None:
        """Close it."""
        self._client.close()


class Moteus(LoopClient):
    """moteus: its CAN adapter on a serial line, 6 data bytes (an answer of 43 bytes in two lines) or 64 (159)."""

    name = "moteus, transaction"
    package = "moteus"

    def __init__(self, size: int) -> None:
        """Ask for a CAN frame whose line is about `size` bytes long."""
        super().__init__(size)
        self._library = import_module("moteus.fdcanusb_device")
        data = bytes(range(6 if size == 14 else 64))
        lines = (b"OK", f"rcv 0180 {data.hex().upper()} b F".encode())
        self.answer = b"".join(self._library._append_checksum(line) + b"\n" for line in lines)  # noqa: SLF001 - its own
        self.answers = (0, self.answer)  # its requests are lines

    async def connect(self, path: str) -> None:
        """Open the port."""
        self._device = self._library.FdcanusbDevice(path)

    def request(self) -> Callable[[], Awaitable[Any]]:
        """Send a CAN frame and wait for one that passes the filter."""
        asked = self._library.Frame(arbitration_id=0x8001, data=bytes(6), dlc=6, is_fd=True)

        async def request() -> None:
            wanted = self._device.Request(asked, frame_filter=lambda frame: frame.arbitration_id == 0x180)
            await self._device.transaction([wanted])
            assert wanted.responses  # noqa: S101 - it returns without one when its time is over

        return request

    async def disconnect(self) -> None:
        """Close it."""
        self.loop.remove_reader(self._device._serial.fd)  # noqa: SLF001 - it would go on watching a closed port
        self._device.close()
        await asyncio.sleep(0.01)


RAW = (Polling,)
LOOPS = (Bare, Ours)
PEERS = (Modbus, Moteus)
