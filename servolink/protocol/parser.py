"""FrameParser: intact frames from a byte stream, cut into chunks at any place and damaged in any way.

The parser takes any bytes and never raises, and the same stream gives the same frames for any size of chunk. A
frame is accepted with a known id, a length by the rule of the id, and the right sum. A rejected frame is searched
inside, not skipped, so that no intact frame inside is lost. `recovery` searches accepted frames too.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from struct import Struct
from typing import Any, ClassVar
from zlib import adler32

from servolink.protocol.codec import PACKETS
from servolink.protocol.frame import (
    HEADER,
    HEADER_SIZE,
    MAGIC,
    OVERHEAD,
    BlockSums,
    ByteOrder,
    Frame,
    checksum,
)
from servolink.protocol.layouts import layout
from servolink.protocol.recovery import DEEPEST, Recovery, next_magic

_REASONS = ("padding", "noise", "unknown id", "length", "checksum", "incomplete")
PADDING, NOISE, UNKNOWN_ID, LENGTH, CHECKSUM, INCOMPLETE = _REASONS
"""Reasons for skipped bytes: zeros after a frame; no start of a frame; a start with an unknown id, a wrong length or a
wrong sum; a frame without an end."""

_MAX_CACHED_HEADERS = 4096  # a stream with more is made to fill memory
_SHORT = 255  # longest content summed by adler32 at once, together with the header's share
_LONG = 4096  # longer contents are summed in remembered blocks, so that overlapping claims stay cheap
_WARY = 256  # number of frames after damage to search for whole frames inside
_ROOMY = OVERHEAD + HEADER_SIZE  # size of a frame with room for the start of another inside

_HEADER = slice(HEADER_SIZE)  # part of data that begins with a frame
_CONTENT = slice(HEADER_SIZE, -1)  # part of data with exactly a frame

_Entry = tuple[int, int, int, Callable[[bytes, int], tuple[Any, ...]] | None]
"""Facts derived from a header: size of the frame, packet id, share of the header in the sum, and the function to cut
content, checksum and next header out of a buffer (None for a content longer than `_SHORT`)."""


class FrameParser:
    """Incremental parser for frames of every packet, requests and responses."""

    REASONS: ClassVar[tuple[str, ...]] = _REASONS
    """Reasons for skipped bytes."""
    PADDING: ClassVar[str] = _REASONS[0]
    """Reason for zeros after a frame, which some boards send."""

    def __init__(self, byte_order: ByteOrder = "little", *, keep_skipped: bool = False) -> None:
        """Start at the beginning of a stream; `keep_skipped` keeps skipped bytes for `take_skipped`."""
        self.byte_order: ByteOrder = byte_order
        self.frames = 0
        """Number of frames accepted so far."""
        self.skipped: dict[str, int] = dict.fromkeys(_REASONS, 0)
        """Bytes skipped so far, by reason."""
        self._entries: dict[bytes, _Entry] = {}
        self._partial: bytes | bytearray = b""  # incomplete rest; a bytearray if likely to grow long in small steps
        self._needed = HEADER_SIZE  # length needed before another look is worthwhile
        self._reason = PADDING
        self._recovery = Recovery(byte_order, partial(_SearchingParser, byte_order), DEEPEST)
        self._wary = 0  # number of further frames to search for whole frames inside
        self._blocks: BlockSums | None = None
        self._skipped: list[tuple[int, bytes, str]] | None = [] if keep_skipped else None

    def feed(self, chunk: bytes | bytearray | memoryview) -> list[Frame]:
        """Take the next bytes of the stream, and return the frames completed by them."""
        partial = self._partial
        if partial:
            partial += chunk
            if len(partial) < self._needed:
                # A long frame in small chunks grows in place; a short frame is cheaper to copy.
                self._partial = bytearray(partial) if len(partial) > _SHORT and type(partial) is bytes else partial
                return []
            return self._scan(partial if type(partial) is bytes else bytes(partial))
        if type(chunk) is not bytes:
            chunk = bytes(chunk)
        # Most responses come as a whole chunk. With nothing else under way, these few steps leave the same state as
        # `_scan`, in 60 % of the time.
        try:
            size, packet_id, total, cut = self._entries[chunk[_HEADER]]
        except KeyError:
            return self._scan(chunk)
        if size == len(chunk) and cut is not None and self._recovery.is_calm and not self._wary:
            content = chunk[_CONTENT]
            if adler32(content, total) & 0xFF == chunk[-1]:
                self._recovery.last = frame = packet_id, content
                self.frames += 1
                return [frame]
        return self._scan(chunk)

    def abandon_frame(self) -> list[Frame]:
        """Stop waiting for the rest of the partial frame, and return the frames inside."""
        data = bytes(self._partial)
        if len(data) < HEADER_SIZE:
            return self._scan(data)  # length not received so far; perhaps not a frame at all
        self._reason = INCOMPLETE
        self._recovery.lose_sync()
        self._skip(data, 0, len(MAGIC), [])
        return self._scan(data, len(MAGIC))

    def finish(self) -> list[Frame]:
        """End the stream: return the last frames, and skip the bytes outside of frames."""
        frames = self._scan(bytes(self._partial)) if len(self._partial) < HEADER_SIZE else []
        while len(self._partial) >= HEADER_SIZE:
            earlier = self.take_skipped() if self._skipped else []
            found = self.abandon_frame()
            if self._skipped is not None:
                self._skipped = earlier + [
                    (len(frames) + before, data, reason) for before, data, reason in self._skipped
                ]
            frames += found
        if self._partial:
            self._reason = INCOMPLETE
            self._skip(bytes(self._partial), 0, len(self._partial), frames)
        self._partial, self._needed, self._blocks = b"", HEADER_SIZE, None
        return frames

    @property
    def partial_frame(self) -> tuple[int, int, int] | None:
        """Packet id, bytes received and total bytes of the incomplete frame; None between frames."""
        entry = self._entries.get(bytes(self._partial[:HEADER_SIZE]))
        return (entry[1], len(self._partial), entry[0]) if entry else None

    def take_skipped(self) -> list[tuple[int, bytes, str]]:
        """Return (frames of the last feed before the span, bytes, reason) of each span skipped since the last call."""
        skipped, self._skipped = self._skipped or [], []
        return skipped

    def _scan(self, data: bytes, at: int = 0) -> list[Frame]:  # noqa: C901, PLR0912, PLR0915 - a call per frame would double its cost
        """Collect the frames of `data` from `at` on, and hold the incomplete rest."""
        frames: list[Frame] = []
        frame: Frame | None = None  # last frame; of frames in a row, `recovery` needs only the last
        entries = self._entries
        needed = HEADER_SIZE  # fewer bytes cannot tell whether a frame begins
        length = len(data)
        room = length - HEADER_SIZE
        header = data[at : at + HEADER_SIZE]
        while True:
            try:
                if not self._wary:
                    while True:  # frames in a row, the usual case, in as few steps as possible
                        size, packet_id, total, cut = entries[header]
                        end = at + size
                        if end > room or cut is None:
                            break
                        content, check, following = cut(data, at)  # a single call cuts the next header, too
                        if adler32(content, total) & 0xFF != check:
                            break
                        frame = packet_id, content
                        frames.append(frame)
                        at, header = end, following
                size, packet_id, total, cut = entries[header]
            except KeyError:
                if at > room and (not header or MAGIC.startswith(header[: len(MAGIC)])):
                    break
                damaged = False
            else:
                end = at + size
                if end <= length:
                    content, check = data[at + HEADER_SIZE : end - 1], data[end - 1]
                    header = data[end : end + HEADER_SIZE]
                    sums = adler32(content, total) if cut is not None else self._long_sum(total, content, data, end)
                else:
                    needed = size
                    break
                if sums & 0xFF == check:
                    # Of 256 damaged frames, 1 passes. Waiting for the next frame as proof would delay every response:
                    # accept now, and let recovery rescan the frame if sync is lost behind it.
                    frame = packet_id, content
                    frames.append(frame)
                    at = end
                    if self._wary:
                        if size >= _ROOMY and MAGIC in content:
                            # After recent damage, the frame inside is more likely swallowed than quoted.
                            self._recovery.accept(frame, at)
                            frame = None
                            frames += self._recovery.take_inside(self._wary)
                            self._reason = PADDING
                        self._wary -= 1
                    continue
                damaged = True
            # No frame begins here.
            if frame is not None:
                self._recovery.accept(frame, at)
                frame = None
            data, at = self._recover(data, at, frames, damaged=damaged)
            length = len(data)  # a rescan can have put bytes in front
            room = length - HEADER_SIZE
            header = data[at : at + HEADER_SIZE]
        recovery = self._recovery
        if frame is not None:
            if recovery.is_calm:
                recovery.last = frame
            else:
                recovery.accept(frame, at)
        self.frames += len(frames)
        self._partial = data[at:]
        self._needed = needed
        if recovery.rereads:
            recovery.move(at)
        if self._blocks is not None:
            self._blocks.move(at)
            if at == length:
                self._blocks = None  # no held bytes are left to sum again
        return frames

    def _long_sum(self, total: int, content: bytes, data: bytes, end: int) -> int:
        """Return the sum of a frame up to `end`, correct in the low 8 bits; the header has the share `total`."""
        if len(content) <= _LONG:
            return total + checksum(content)
        if self._blocks is None:
            self._blocks = BlockSums()
        return total + self._blocks.sum(data, end - 1 - len(content), end - 1)

    def _recover(self, data: bytes, at: int, frames: list[Frame], *, damaged: bool) -> tuple[bytes, int]:
        """Continue at a place without a frame: return the buffer and the next position to scan."""
        recovery = self._recovery
        head = data[at : at + HEADER_SIZE]
        if recovery.in_sync:
            self._reason = PADDING
        recovery.lose_sync(search=True)
        if head.startswith(MAGIC):
            reason = CHECKSUM if damaged else self._admit(head)
            if not reason:
                return data, at  # the next look finds the header among the known headers
            # A frame right after the last frame, even damaged, shows that the last frame ended in the right place.
            recovery.lose_sync()
            self._reason = reason
            self._skip(data, at, at + len(MAGIC), frames)
            return data, at + len(MAGIC)  # the magic cannot overlap itself
        if self._reason == PADDING:
            if not data[at]:
                return data, self._skip_padding(data, at, frames)
            # Anything but a frame or zeros behind a frame: the frame may be too long, and have swallowed others.
            self._reason = NOISE
            if (again := recovery.rescan(data, at)) is not None:
                self._wary = _WARY
                if self._blocks is not None:
                    self._blocks.move(len(data) - len(again[0]))
                return again
        end = next_magic(data, at + 1)
        self._skip(data, at, end, frames)
        return data, end

    def _skip_padding(self, data: bytes, at: int, frames: list[Frame]) -> int:
        """Skip zeros, add the frames found to end within the zeros, and return the end of the zeros."""
        end = self._recovery.padding_end(data, at, self._wary)
        self._skip(data, at, end, frames)
        if found := self._recovery.read_padding(data[at:end]):
            frames += found
            self._wary = _WARY
        return end

    def _admit(self, header: bytes) -> str:
        """Remember the facts of `header`; return the reason to reject the header, empty for a valid header."""
        _, packet_id, length = HEADER[self.byte_order].unpack(header)
        declared = PACKETS.get(packet_id)
        if declared is None:
            return UNKNOWN_ID
        if not self._admits(packet_id, length):
            return LENGTH
        if len(self._entries) >= _MAX_CACHED_HEADERS:
            self._entries.clear()
        cut = _cutter(length) if length <= _SHORT else None
        self._entries[header] = length + OVERHEAD, packet_id, sum(header) & 0xFF, cut
        return ""

    def _admits(self, packet_id: int, length: int) -> bool:
        """Return whether a content may have so many bytes."""
        return layout(PACKETS[packet_id], self.byte_order).rule.admits(length)

    def _skip(self, data: bytes, start: int, end: int, frames: list[Frame]) -> None:
        """Count bytes as skipped, except bytes read again and counted before."""
        start = self._recovery.first_unread(start)
        if start >= end:
            return
        self.skipped[self._reason] += end - start
        if self._reason != PADDING:
            self._wary = _WARY
        if self._skipped is not None:
            self._skipped.append((len(frames), data[start:end], self._reason))


@cache
def _cutter(length: int) -> Callable[[bytes, int], tuple[Any, ...]]:
    return Struct(f"{HEADER_SIZE}x{length}sB{HEADER_SIZE}s").unpack_from


class _SearchingParser(FrameParser):
    """A parser for the inside of a frame, as used by `recovery`."""

    def __init__(self, byte_order: ByteOrder, deepest: int, wary: int) -> None:
        super().__init__(byte_order)
        self._recovery = Recovery(byte_order, partial(_SearchingParser, byte_order), deepest)
        self._wary = wary

    @property
    def recovery(self) -> Recovery:
        """Recovery state of the inner parser."""
        return self._recovery

    @property
    def partial(self) -> bytes:
        """Bytes of the incomplete frame so far."""
        return bytes(self._partial)

    @property
    def missing(self) -> int:
        """Number of further bytes needed at least."""
        return self._needed - len(self._partial)
