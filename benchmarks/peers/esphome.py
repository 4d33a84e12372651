"""aioesphomeapi: the plain-text framer of ESPHome's interface, compiled by Cython."""

from __future__ import annotations

import asyncio
from importlib import import_module
from typing import Any

from benchmarks.peers.peer import Peer, content

_framer = import_module("aioesphomeapi._frame_helper.plain_text")
_connection = import_module("aioesphomeapi.connection")
_TYPE = 127  # one byte, as those of its small packets


class Esphome(Peer):
    """Its framer, with the cheapest receiver that keeps the frames; what it would do with them is left out."""

    name = "aioesphomeapi"
    package = "aioesphomeapi"
    work = "lengths, no checksum, Cython; (type, bytes)"
    fairness = "theirs: compiled, no checksum, no search for the start of a frame"
    resync = "never: the connection is closed"
    validates = False
    compiled = True

    def __init__(self) -> None:
        """Begin a stream."""
        self._frames: list[tuple[int, bytes]] = []
        self._feed = self._framer().data_received

    def _framer(self) -> Any:
        collect = self._frames.append

        def receive(kind: int, data: bytes) -> None:
            collect((kind, data))

        return _with_receiver(receive, self._close)

    def _close(self, error: Exception) -> None:
        self._feed = lambda chunk: None

    @staticmethod
    def frame(size: int, number: int) -> bytes | None:
        """Return a frame of a message."""
        return _message(size, number, _TYPE)

    def feed(self, chunk: bytes) -> list[Any]:
        """Hand the chunk to the framer, which calls the receiver for each frame."""
        self._frames.clear()
        self._feed(chunk)
        return self._frames

    def content(self, frame: tuple[int, bytes]) -> bytes:
        """Return the message."""
        return frame[1]


def _message(size: int, number: int, kind: int) -> bytes:
    length = size - 3 if size < 128 else size - 4
    varint = bytes([length]) if length < 128 else bytes([length & 127 | 128, length >> 7])
    return b"\0" + varint + bytes([kind]) + content(length, number)


def _with_receiver(receive: Any, close: Any) -> Any:
    """Return a framer on a connection that has never been opened."""
    members = {
        "__init__": lambda self: None,
        "process_packet": staticmethod(receive),
        "report_fatal_error": staticmethod(close),
    }

    async def make() -> Any:
        return _framer.APIPlaintextFrameHelper(type("Receiver", (_connection.APIConnection,), members)(), "", "")

    return asyncio.run(make())
