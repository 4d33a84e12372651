"""moteus: lines of its CAN adapter with checksums, read by its own reader task."""

from __future__ import annotations

from collections.abc import Generator
from importlib import import_module
from random import Random
from types import coroutine
from typing import Any
from unittest.mock import patch

from benchmarks.peers.peer import Peer, content

_device = import_module("moteus.fdcanusb_device")
_MOST_DATA = 64  # of a CAN FD frame


@coroutine
def _next_chunk() -> Generator[None, bytes, bytes]:
    return (yield)


class _Port:
    """A port that gives what is sent into the reader."""

    async def read(self, size: int, *, block: bool) -> bytes:
        return await _next_chunk()


class Moteus(Peer):
    """Its reader of a serial line."""

    name = "moteus"
    package = "moteus"
    work = "text line, CRC-8 by table, hexadecimal; CAN frame object"
    fairness = "ours: text has twice the bytes, and its CRC is a loop in Python"
    resync = "the next line"
    builds = True

    def __init__(self) -> None:
        """Begin a stream."""
        with (
            patch.object(_device.aioserial, "AioSerial", lambda **_: _Port()),
            patch.object(_device.FdcanusbDevice, "_start_reader"),
        ):
            self._device = _device.FdcanusbDevice()
        self._frames: list[Any] = []
        self._device._handle_received_frame = self._collect  # noqa: SLF001 - instead of its queue, which ends at 50
        self._begin()

    @staticmethod
    def frame(size: int, number: int) -> bytes | None:
        """Return a received CAN frame of 6 bytes (35 on the line) or of 64 (151)."""
        if size > 186:
            return None
        return _line(size, number, 0x8001)

    @staticmethod
    def mixed(size: int, number: int) -> bytes | None:
        """Return a CAN frame from one of 44 devices."""
        return None if size > 186 else _line(size, number, 0x8000 + Random(number).randrange(1, 45))

    def feed(self, chunk: bytes) -> list[Any]:
        """Wake the reader with the chunk."""
        self._frames.clear()
        try:
            self._send(chunk)
        except Exception:  # noqa: BLE001 - its reader task ends with whatever a bad line raises
            self._begin()
        return self._frames

    def content(self, frame: Any) -> bytes:
        """Return the data of the CAN frame."""
        return bytes(frame.data)

    def _begin(self) -> None:
        """Let a reader run until it waits for bytes, another one for each line that ends one."""
        while True:
            self._device._running = True  # noqa: SLF001 - it has no other way to begin again
            self._send = self._device._reader_loop().send  # noqa: SLF001 - the task it would start on an event loop
            try:
                self._send(None)
            except Exception:  # noqa: BLE001, S112 - see above
                continue
            return

    async def _collect(self, frame: Any) -> None:
        self._frames.append(frame)


def _line(size: int, number: int, identity: int) -> bytes:
    data = content(6 if size == 14 else _MOST_DATA, number)
    line = f"rcv {identity:04X} {data.hex().upper()} E B F"
    return bytes(_device._append_checksum(line.encode())) + b"\n"  # noqa: SLF001 - its own writer uses it
