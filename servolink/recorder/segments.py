"""Segments: the latest messages, compressed, in bounded memory."""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import msgspec

from servolink.files import MIB
from servolink.recorder.backlog import Timed
from servolink.recorder.channels import TOPICS, encode
from servolink.recorder.writer import CHUNK_BYTES, CHUNK_SECONDS

MOST_BYTES = 64 * MIB
"""Bytes of compressed messages that are kept, however long the time asked for."""


class _Segment(NamedTuple):
    """Some messages, compressed."""

    first: float
    last: float
    messages: int
    data: bytes


class Segments:
    """The latest messages, as many as fit into a time and a number of bytes."""

    def __init__(self, seconds: float, most_bytes: int = MOST_BYTES) -> None:
        """Start empty."""
        self._seconds = seconds
        self._most_bytes = most_bytes
        self._closed: deque[_Segment] = deque()
        self._open: list[tuple[float, str, bytes]] = []
        self._open_bytes = 0
        self.size = 0
        """Bytes of the closed segments."""
        self.count = 0
        """Messages in all."""

    @property
    def first(self) -> float | None:
        """When the oldest message was; None if there is none."""
        return self._closed[0].first if self._closed else self._open[0][0] if self._open else None

    def add(self, timed: Timed) -> None:
        """Add a message, and drop what is too old, or too much."""
        data = encode(timed.message)
        self._open.append((timed.seconds, TOPICS[type(timed.message)], data))
        self._open_bytes += len(data)
        self.count += 1
        if self._open_bytes >= CHUNK_BYTES or timed.seconds - self._open[0][0] >= CHUNK_SECONDS:
            self._close()
        self._trim(timed.seconds)

    def messages(self) -> Iterator[tuple[float, str, bytes]]:
        """Yield all messages, with their topics; one segment at a time is not compressed."""
        for segment in self._closed:
            yield from msgspec.msgpack.decode(zlib.decompress(segment.data), type=list[tuple[float, str, bytes]])
        yield from self._open

    def clear(self) -> None:
        """Drop everything."""
        while self._closed:
            self._drop()
        self._open, self._open_bytes, self.count = [], 0, 0

    def _close(self) -> None:
        data = zlib.compress(msgspec.msgpack.encode(self._open), 1)
        self._closed.append(_Segment(self._open[0][0], self._open[-1][0], len(self._open), data))
        self.size += len(data)
        self._open, self._open_bytes = [], 0

    def _trim(self, now: float) -> None:
        while self._closed and (self._closed[0].last < now - self._seconds or self.size > self._most_bytes):
            self._drop()

    def _drop(self) -> None:
        segment = self._closed.popleft()
        self.size -= len(segment.data)
        self.count -= segment.messages
