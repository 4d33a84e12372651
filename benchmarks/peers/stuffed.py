"""cobs: frames without a zero byte, and a sum, as with a microcontroller at the other end.

The sum is taken as ours is, by `adler32`: a loop in C that every program can use.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any
from zlib import adler32

from benchmarks.peers.peer import Peer, content
from servolink.protocol.frame import checksum

_cobs = import_module("cobs.cobs")
_EXACT = 257  # a frame up to here has a content whose sum adler32 has exactly


class Cobs(Peer):
    """Its decoder, and around it the buffer and the sum that it does not have."""

    name = "cobs"
    package = "cobs"
    work = "split at zeros, decoder in C, sum by adler32 as ours; bytes"
    fairness = "theirs: split and decoder are loops in C, and it checks neither id nor length"
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
            if not frame:
                continue
            total = adler32(frame[:-1], 0) if len(frame) <= _EXACT else checksum(frame[:-1])
            if total & 0xFF == frame[-1]:
                frames.append(frame)
        return frames

    def content(self, frame: bytes) -> bytes:
        """Return the frame itself."""
        return frame
