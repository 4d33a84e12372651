"""Frames of one direction, of any byte order and id: a connection's parser knows both, and the scanner neither.

What is damaged or unknown is what a spy looks for, so it is returned too.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple, TypeAlias

from servolink.protocol import MAGIC, PACKETS, ByteOrder, FrameAt, layout, next_magic

Kind: TypeAlias = Literal["packet", "unknown", "damaged", "noise"]
"""Kind of piece: frame of the document, intact undefined frame, frame with a wrong sum, or other bytes."""

_BYTE_ORDERS: tuple[ByteOrder, ...] = ("little", "big")
_MOST_UNKNOWN = 1024  # bytes for which an unknown frame may keep others waiting
_MOST_NOISE = 0x10000
_SILENCE = 0.5  # seconds after which the rest of a frame counts as lost


class Seen(NamedTuple):
    """Frame, or bytes that belong to no frame."""

    kind: Kind
    data: bytes
    """All of it."""
    byte_order: ByteOrder = "little"
    packet_id: int = 0

    @property
    def content(self) -> bytes:
        """The content of a frame."""
        frame = FrameAt.read(self.data, 0, self.byte_order)
        return b"" if frame is None else frame.content


class Scanner:
    """Finder of frames in one direction of a conversation."""

    def __init__(self) -> None:
        self._held = b""
        self._heard_at = 0.0

    def feed(self, seconds: float, data: bytes) -> list[Seen]:
        """Take bytes that passed at `seconds`; return the pieces that are complete now."""
        found = self.finish() if self._held and seconds - self._heard_at > _SILENCE else []
        self._heard_at = seconds
        self._held += data
        return found + list(self._scan(is_over=False))

    def finish(self) -> list[Seen]:
        """Stop waiting for the rest of a frame; return the bytes held back."""
        return list(self._scan(is_over=True))

    def _scan(self, *, is_over: bool) -> Iterator[Seen]:
        data, at, noise = self._held, 0, 0  # noise begins at `noise`, up to `at`
        while at < len(data):
            found = _look(data, at, is_over=is_over)
            if found is None:
                break
            if found.kind == "noise":
                at += len(found.data)
                if at - noise < _MOST_NOISE:
                    continue
            if noise < at:
                yield Seen("noise", data[noise:at])
            if found.kind != "noise":
                yield found
                at += len(found.data)
            noise = at
        if noise < at:
            yield Seen("noise", data[noise:at])
        self._held = data[at:]


def _look(data: bytes, at: int, *, is_over: bool) -> Seen | None:
    """Return the piece that begins at `at`; None if more bytes are needed."""
    start = next_magic(data, at)
    if start > at:
        return Seen("noise", data[at:start])
    unknown, is_cut = None, False
    for byte_order in _BYTE_ORDERS:
        frame = FrameAt.read(data, at, byte_order)
        if frame is None:
            return Seen("noise", data[at:]) if is_over else None
        declared = PACKETS.get(frame.packet_id)
        if declared is not None and layout(declared, byte_order).rule.admits(frame.length):
            if frame.is_intact:
                return Seen("packet", frame.data, byte_order, frame.packet_id)
            return _damaged(frame, byte_order) if frame.is_whole or is_over else None
        if declared is None:
            is_cut |= not frame.is_whole and frame.length <= _MOST_UNKNOWN
            # Without content, the length is 0 in both byte orders. The document's ids end in 0 or 1.
            if frame.is_intact and (unknown is None or frame.packet_id % 10 <= 1):
                unknown = Seen("unknown", frame.data, byte_order, frame.packet_id)
    if unknown is not None:
        return unknown
    return None if is_cut and not is_over else Seen("noise", MAGIC)


def _damaged(frame: FrameAt, byte_order: ByteOrder) -> Seen:
    """Return a frame with a wrong sum, or only its part before the next frame: a damaged length swallows frames."""
    inner = frame.data.find(MAGIC, len(MAGIC))
    if inner >= 0:
        return Seen("noise", frame.data[:inner])
    return Seen("damaged" if frame.is_whole else "noise", frame.data, byte_order, frame.packet_id)
