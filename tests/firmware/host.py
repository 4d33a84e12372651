"""The firmware compiled for this computer: a program, and a board in this process with virtual time."""

from __future__ import annotations

import asyncio
import ctypes
import fcntl
import os
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Protocol

import pytest

import servolink
from servolink.transports import BaseTransport
from tests import processes

FIRMWARE = Path(servolink.__file__).parent / "firmware"
FLAGS = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-Wconversion",
    "-Wpedantic",
    "-Wno-unused-parameter",
    "-g",
    "-O1",
    "-fsanitize=undefined",
    "-fno-sanitize-recover=all",
]
CORE = sorted(FIRMWARE.glob("core/*.c"))
HARDWARE = FIRMWARE / "host/hardware.c"
LIBRARY = ("-shared", "-fPIC")
"""Flags for a library."""
MEMORY = 65536
"""Bytes for records."""
FLASH = 3 * MEMORY
PERIOD = 0.02
"""Seconds between two pulses."""

needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc, of the Debian package gcc")


def compile_program(target: Path, sources: Iterable[Path], *flags: str, compiler: str = "gcc") -> Path:
    """Compile C sources with the core into `target`."""
    processes.run((compiler, *FLAGS, *flags, "-o", str(target), *map(str, [*CORE, *sources])), check=True)
    return target


def compile_once(factory: pytest.TempPathFactory, name: str, sources: Iterable[Path], *flags: str) -> Path:
    """Compile C sources with the core, once for all processes of a test run."""
    folder = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    target = folder / name
    with (folder / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not target.exists():
            compile_program(target, sources, *flags)
    return target


def compile_library(target: Path) -> Path:
    """Compile the core with its hardware in memory as a library."""
    return compile_program(target, [HARDWARE], *LIBRARY)


class _Range(ctypes.Structure):
    _fields_ = (
        ("shortest", ctypes.c_uint16),
        ("longest", ctypes.c_uint16),
        ("least", ctypes.c_int16),
        ("greatest", ctypes.c_int16),
    )


class _Fields(ctypes.Structure):
    _fields_ = (
        ("now", ctypes.c_uint64),
        ("flash", ctypes.POINTER(ctypes.c_uint8)),
        ("pulses", ctypes.c_uint32 * 16),
        ("pressed", ctypes.c_uint32),
        ("millivolts", ctypes.c_uint32),
        ("periods", ctypes.c_uint32),
        ("erases", ctypes.c_uint32 * (FLASH // 4096)),
        ("offset", ctypes.c_uint32),
        ("size", ctypes.c_uint32),
        ("is_erase", ctypes.c_bool),
        ("until", ctypes.c_uint64),
        ("page", ctypes.c_uint8 * 256),
        ("magic", ctypes.c_char * 16),
        ("servos", ctypes.c_uint8),
        ("buttons", ctypes.c_uint8),
        ("battery_empty", ctypes.c_uint16),
        ("battery_full", ctypes.c_uint16),
        ("reserved", ctypes.c_uint16),
        ("ranges", _Range * 16),
    )


def load(library: Path) -> Any:
    """Return the functions of `host/hardware.h` in a library."""
    loaded = ctypes.CDLL(str(library))
    loaded.hardware_new.restype = ctypes.POINTER(_Fields)
    loaded.hardware_transmit.restype = ctypes.c_size_t
    for name in ("start", "tick", "detach", "delete"):
        loaded[f"hardware_{name}"].argtypes = [ctypes.POINTER(_Fields)]
    return loaded


class HostBoard:
    """Board with its hardware, at a time of its own in microseconds."""

    def __init__(self, functions: Any, now: int = 0, servos: int = 16, angles: tuple[float, float] = (-90, 90)) -> None:
        """Power up with blank flash. `angles` are those of the shortest and of the longest pulse."""
        self._functions = functions
        self._hardware = functions.hardware_new(None)
        self.fields = self._hardware.contents
        self.fields.now = now
        self.fields.servos = servos
        for servo in self.fields.ranges:
            servo.least, servo.greatest = map(int, angles)
        self._buffer = ctypes.create_string_buffer(1 << 17)
        self._view = memoryview(self._buffer)
        functions.hardware_start(self._hardware)

    def copy(self) -> HostBoard:
        """Return another board with the same flash, which was just switched on."""
        other = HostBoard(self._functions, self.fields.now)
        ctypes.memmove(other.fields.flash, self.fields.flash, FLASH)
        self._functions.hardware_start(other._hardware)
        return other

    def close(self) -> None:
        """Free the memory."""
        self._functions.hardware_delete(self._hardware)

    @property
    def pulses(self) -> list[float]:
        """Widths of the pulses in microseconds, 0 for released servos."""
        return [width / 1000 for width in self.fields.pulses]

    @property
    def is_busy(self) -> bool:
        """Whether flash is being erased or programmed."""
        return bool(self.fields.size)

    def tick(self, now: int | None = None) -> None:
        """Let the board do what is due, at the time `now`."""
        if now is not None:
            self.fields.now = now
        self._functions.hardware_tick(self._hardware)

    def run(self, seconds: float, step: int = 2000) -> bytes:
        """Let time pass, and return what the board transmits meanwhile."""
        sent = b""
        for _ in range(0, round(seconds * 1e6), step):
            self.tick(self.fields.now + step)
            sent += self.transmit()
        return sent

    def detach(self) -> None:
        """Detach the host."""
        self._functions.hardware_detach(self._hardware)

    def receive(self, data: bytes) -> None:
        """Give the board bytes of the host."""
        self._functions.hardware_receive(self._hardware, data, len(data))

    def receive_once(self, data: bytes) -> None:
        """Give the board bytes of the host, of which it does what one call does."""
        self._functions.hardware_receive_once(self._hardware, data, len(data))

    def transmit(self) -> bytes:
        """Return bytes for the host, up to the size of the ring in the board."""
        size = self._functions.hardware_transmit(self._hardware, self._buffer, len(self._buffer))
        return bytes(self._view[:size])

    def ask(self, frame: bytes, seconds: float = 0.2) -> bytes:
        """Return what the board transmits within some time after a request, which ends early with the response."""
        self.receive(frame)
        sent, until = self.transmit(), self.fields.now + round(seconds * 1e6)
        while not sent and self.fields.now < until:
            self.tick(self.fields.now + 500)
            sent = self.transmit()
        return sent

    def cut_power(self, random: int, *, off: int = 1000) -> None:
        """Lose power in the middle of what flash does, and come back after `off` microseconds."""
        self._functions.hardware_cut(self._hardware, random)
        self.fields.now += off
        self._functions.hardware_start(self._hardware)


class AnyBoard(Protocol):
    """Board whose time, in microseconds, goes on only in `tick`."""

    def receive(self, data: bytes) -> None:
        """Take bytes of the host."""

    def tick(self, now: int) -> None:
        """Do what is due up to the time `now`."""

    def transmit(self) -> bytes:
        """Return bytes for the host."""
        ...


class HostTransport(BaseTransport):
    """Transport to a board, whose time is that of the event loop."""

    def __init__(self, board: AnyBoard) -> None:
        """Prepare the transport."""
        super().__init__("test://firmware")
        self._board = board
        self._timer: asyncio.TimerHandle | None = None

    async def _open(self) -> None:
        self._tick()

    def _tick(self) -> None:
        loop = asyncio.get_running_loop()
        self._board.tick(round(loop.time() * 1e6))
        if data := self._board.transmit():
            self._deliver(data)
        if self._stage in {"opening", "open"}:
            self._timer = loop.call_later(0.002, self._tick)

    def _send(self, data: bytes) -> None:
        self._board.receive(data)
        asyncio.get_running_loop().call_soon(self._tick_once)

    def _tick_once(self) -> None:
        if self._stage == "open" and (data := self._board.transmit()):
            self._deliver(data)

    def _abort(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    async def _close(self) -> None:
        self._abort()
