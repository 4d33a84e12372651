"""cobs: frames without a zero byte, and a sum, as with a microcontroller at the other end."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from benchmarks.peers.peer import Peer, content

_cobs = import_module("cobs.cobs")


class Cobs(Peer):
    """Its decoder, and around it the buffer and the sum that it does not have."""

    name = "cobs"
    package = "cobs"
    work = "split at zeros, decoder in C, sum; bytes"
    resync = "the next zero"
    compiled = True

    def __init__(self) -> None:
        """Begin a stream."""
        self._held = b""

    @staticmethod
    def frame(size: int, number: int) -> bytes | None:
        """Return a frame that ends with its sum and a zero; longer contents take a byte more for each 254."""
        inside = content(size - 3 - size // 255, number)
        return bytes(_cobs.encode(inside + bytes([sum(inside) & 0xFF]))) + b"\0"

    def feed(self, chunk: bytes) -> list[Any]:
        """Decode between the zeros."""
        pieces = (self._held + chunk).split(b"\0")
        self._held = pieces.pop()
        frames, decode = [], _cobs.decode
        for piece in pieces:
            try:
                frame = decode(piece)
            except _cobs.DecodeError:
                continue
            if frame and sum(frame[:-1]) & 0xFF == frame[-1]:
                frames.append(frame)
        return frames

    def content(self, frame: bytes) -> bytes:
        """Return the frame itself."""
        return frame
