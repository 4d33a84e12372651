"""FrameParser: the intact frames in a byte stream, however it is cut and damaged.

The parser is total: it takes any bytes and never raises, and the same stream gives the same frames however it is cut.
A frame is accepted when its id is known, its length obeys the rule of that id and its sum is right. A rejected frame is
searched inside, not skipped, so that no intact frame inside it is lost. `recovery` searches accepted ones too.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from struct import Struct
from typing import Any
from zlib import adler32

from servolink.protocol.codec import PACKETS
from servolink.protocol.frame import (
    HEADER,
    HEADER_SIZE,
    MAGIC,
    BlockSums,
    ByteOrder,
    Frame,
    piecewise,
)
from servolink.protocol.layout import layout
from servolink.protocol.recovery import DEEPEST, Recovery, next_magic

REASONS = ("padding", "noise", "unknown id", "length", "checksum", "incomplete")
PADDING, NOISE, UNKNOWN_ID, LENGTH, CHECKSUM, INCOMPLETE = REASONS
"""Why bytes were skipped: zeros after a frame; no start of a frame; a start whose id, length or sum is wrong; a frame
that never ended."""

_MAX_KNOWN_HEADERS = 4096  # a stream with more is made to fill memory
_LONG = 4096  # contents above are summed in blocks that are remembered, so that overlapping claims stay cheap
_WARY = 256  # after damage, as many frames are searched for whole frames inside
_ROOMY = 2 * HEADER_SIZE  # where the checksum of a frame stands that has room for another inside

_SHORT = 255 + HEADER_SIZE  # where the checksum stands behind the longest content that adler32 sums at once

_Entry = tuple[int, int, int, Any]
"""What a header implies: where the checksum stands, packet id, the header's share of the sum, and how to cut.

A frame up to `_SHORT` is cut into content, checksum and next header by a call; a longer content into pieces by a
Struct; one above `_LONG` (False) into blocks whose sums are remembered."""


class FrameParser:
    """Incremental parser for frames of every packet, requests and responses."""

    def __init__(self, byte_order: ByteOrder = "little", *, keep_skipped: bool = False) -> None:
        """Start at the beginning of a stream; `keep_skipped` keeps skipped bytes for `take_skipped`."""
        self.byte_order: ByteOrder = byte_order
        self.frames = 0
        """Number of frames accepted so far."""
        self.skipped: dict[str, int] = dict.fromkeys(REASONS, 0)
        """Bytes skipped so far, by reason."""
        self._entries: dict[bytes, _Entry] = {}
        self._known = self._entries.get  # bound once: every chunk needs it
        self._held: bytes | bytearray = b""  # the incomplete rest; a bytearray while it grows in small steps
        self._needed = 0  # how long it must get before another look is worth it
        self._reason = PADDING
        self._recovery = Recovery(byte_order, partial(_InnerParser, byte_order), DEEPEST)
        self._accept = self._recovery.accept
        self._wary = 0  # how many more frames are searched for whole frames inside
        self._blocks: BlockSums | None = None
        self._kept: list[tuple[int, bytes, str]] | None = [] if keep_skipped else None

    def feed(self, chunk: bytes | bytearray | memoryview) -> list[Frame]:
        """Take the next bytes of the stream and return the frames that are now complete."""
        held = self._held
        if not held:
            return self._scan(chunk if isinstance(chunk, bytes) else bytes(chunk), 0)
        if len(held) + len(chunk) < self._needed:
            if isinstance(held, bytes):
                held = self._held = bytearray(held)
            held += chunk
            return []
        return self._scan(b"".join((held, chunk)), 0)

    def abandon_frame(self) -> list[Frame]:
        """Stop waiting for the rest of the partial frame and return the frames inside it."""
        data = bytes(self._held)
        if len(data) < HEADER_SIZE:
            return self._scan(data, 0)  # it has claimed no length yet, and may not be a frame at all
        self._reason = INCOMPLETE
        self._recovery.lose_sync()
        self._skip(data, 0, len(MAGIC), [])
        return self._scan(data, len(MAGIC))

    def finish(self) -> list[Frame]:
        """End the stream: return the last frames and skip what never became one."""
        frames = self._scan(bytes(self._held), 0) if len(self._held) < HEADER_SIZE else []
        while len(self._held) >= HEADER_SIZE:
            earlier = self.take_skipped() if self._kept else []
            found = self.abandon_frame()
            if self._kept is not None:
                self._kept = earlier + [(len(frames) + before, data, reason) for before, data, reason in self._kept]
            frames += found
        if self._held:
            self._reason = INCOMPLETE
            self._skip(bytes(self._held), 0, len(self._held), frames)
        self._held = b""
        return frames

    @property
    def partial_frame(self) -> tuple[int, int, int] | None:
        """Packet id, bytes received and bytes wanted of the frame that is incomplete; None between frames."""
        entry = self._entries.get(bytes(self._held[:HEADER_SIZE]))
        return (entry[1], len(self._held), entry[0] + 1) if entry else None

    def take_skipped(self) -> list[tuple[int, bytes, str]]:
        """Return (frames of the last call before it, bytes, reason) of each span skipped since the last call."""
        taken, self._kept = self._kept or [], []
        return taken

    def _scan(self, data: bytes, at: int) -> list[Frame]:  # noqa: C901, PLR0912, PLR0915 - a call per frame would double its cost
        """Collect the frames of `data` from `at` on and hold the incomplete rest."""
        frames: list[Frame] = []
        known = self._known
        settled = 0  # frames known to `recovery`: it needs only the last one before anything else happens
        wary = self._wary
        length = len(data)
        room = length - HEADER_SIZE
        needed = 1
        header = data[at : at + HEADER_SIZE]
        entry = known(header) if header else None
        while True:
            if entry is not None:
                last, packet_id, total, cut = entry
                end = at + last
                if end < room and last <= _SHORT:  # one call cuts content, checksum and the next header
                    content, check, following = cut(data, at)
                    sums = adler32(content, total)
                elif end < length:
                    content = data[at + HEADER_SIZE : end]
                    check = data[end]
                    following = None
                    if last <= _SHORT:
                        sums = adler32(content, total)
                    elif cut:
                        sums = total + sum(map(adler32, cut.unpack(content)))
                    else:
                        sums = total + self._block_sums().sum(data, at + HEADER_SIZE, end)
                else:
                    needed = last + 1
                    break
                if sums & 0xFF == check:
                    # One damaged frame in 256 passes. Waiting for the next to confirm it would delay every
                    # response: accept it now, let recovery rescan it if sync is lost behind it.
                    frames.append((packet_id, content))
                    at = end + 1
                    if wary:
                        wary -= 1
                        if last >= _ROOMY and MAGIC in content:
                            # Damage was seen lately: the frame inside is more likely swallowed than quoted.
                            self._accept(frames[-1], at)
                            frames += self._recovery.take_inside(self._wary)
                            self._reason = PADDING
                            settled = len(frames)
                    if following is None:
                        if at == length:
                            break
                        following = data[at : at + HEADER_SIZE]
                    if following != header:  # most frames are followed by others of their kind
                        header = following
                        entry = known(header)
                    continue
            if at == length:
                break
            # No frame stands here, or none any more.
            if len(frames) > settled:
                self._accept(frames[-1], at)
            self._wary = wary
            data, at, wanted = self._recover(data, at, frames, damaged=entry is not None)
            wary = self._wary
            length = len(data)  # a rescan can have put bytes in front
            room = length - HEADER_SIZE
            settled = len(frames)
            if wanted:
                needed = wanted
                break
            header = data[at : at + HEADER_SIZE]
            entry = known(header)
        if len(frames) > settled:
            self._accept(frames[-1], at)
        self._wary = wary
        self.frames += len(frames)
        self._held = data[at:]
        self._needed = needed
        if self._recovery.rereads:
            self._recovery.move(at)
        if self._blocks is not None:
            self._blocks.move(at)
        return frames

    def _recover(self, data: bytes, at: int, frames: list[Frame], *, damaged: bool) -> tuple[bytes, int, int]:
        """Continue where no frame is: return buffer, position, and how many bytes are needed there (0: scan on)."""
        recovery = self._recovery
        head = data[at : at + HEADER_SIZE]
        if len(head) < HEADER_SIZE and MAGIC.startswith(head[: len(MAGIC)]):
            return data, at, HEADER_SIZE  # fewer bytes cannot tell whether it is a frame
        if recovery.in_sync:
            self._reason = PADDING
        recovery.lose_sync(search=True)
        if head.startswith(MAGIC):
            reason = CHECKSUM if damaged else self._admit(head)
            if not reason:
                return data, at, 0  # the next look finds the header among the known ones
            # A frame that follows the last one, even a damaged one, says that the last one ended where it should.
            recovery.lose_sync()
            self._reason = reason
            self._skip(data, at, at + len(MAGIC), frames)
            return data, at + len(MAGIC), 0  # the magic cannot overlap itself
        if self._reason == PADDING:
            if not data[at]:
                return data, self._skip_padding(data, at, frames), 0
            # Anything but a frame or zeros behind a frame: it may have ended too late and swallowed others.
            self._reason = NOISE
            if (again := recovery.rescan(data, at)) is not None:
                self._wary = _WARY
                if self._blocks is not None:
                    self._blocks.move(len(data) - len(again[0]))
                return *again, 0
        end = next_magic(data, at + 1)
        self._skip(data, at, end, frames)
        return data, end, 0

    def _skip_padding(self, data: bytes, at: int, frames: list[Frame]) -> int:
        """Skip zeros, add the frames that turn out to end in them, and return where they end."""
        end = self._recovery.padding_end(data, at, self._wary)
        self._skip(data, at, end, frames)
        if found := self._recovery.read_padding(data[at:end]):
            frames += found
            self._wary = _WARY
        return end

    def _block_sums(self) -> BlockSums:
        if self._blocks is None:
            self._blocks = BlockSums()
        return self._blocks

    def _admit(self, header: bytes) -> str:
        """Remember what `header` implies; return why it cannot be one, empty if it can."""
        _, packet_id, length = HEADER[self.byte_order].unpack(header)
        declared = PACKETS.get(packet_id)
        if declared is None:
            return UNKNOWN_ID
        if not layout(declared, self.byte_order).rule.admits(length):
            return LENGTH
        if len(self._entries) >= _MAX_KNOWN_HEADERS:
            self._entries.clear()
        self._entries[header] = length + HEADER_SIZE, packet_id, *_summing(header, length)
        return ""

    def _skip(self, data: bytes, start: int, end: int, frames: list[Frame]) -> None:
        """Count bytes as skipped, unless they are read again and have been counted before."""
        start = self._recovery.first_unread(start)
        if start >= end:
            return
        self.skipped[self._reason] += end - start
        if self._reason != PADDING:
            self._wary = _WARY
        if self._kept is not None:
            self._kept.append((len(frames), data[start:end], self._reason))


def _summing(header: bytes, length: int) -> tuple[int, Any]:
    """Return the header's share of the sum, and how to cut the content, for an `_Entry`."""
    total = sum(header)
    if length + HEADER_SIZE <= _SHORT:
        # Adler32 begins at this share, and its low half stays below 65,521: it is the sum of both.
        return total & 0xFF, _cutter(length)
    if length > _LONG:
        return total, False
    pieces = piecewise(length)
    return total - -(-length // 256), pieces  # each piece's adler32 begins at one


@cache
def _cutter(length: int) -> Callable[[bytes, int], tuple[Any, ...]]:
    return Struct(f"{HEADER_SIZE}x{length}sB{HEADER_SIZE}s").unpack_from


class _InnerParser(FrameParser):
    """A parser for the inside of a frame, as `recovery` uses it."""

    def __init__(self, byte_order: ByteOrder, deepest: int, wary: int) -> None:
        super().__init__(byte_order)
        self._recovery = Recovery(byte_order, partial(_InnerParser, byte_order), deepest)
        self._accept = self._recovery.accept
        self._wary = wary

    @property
    def recovery(self) -> Recovery:
        """Its own recovery."""
        return self._recovery

    @property
    def held(self) -> bytes:
        """The bytes of the frame that it has not received whole."""
        return bytes(self._held)

    @property
    def missing(self) -> int:
        """How many more bytes it needs at least."""
        return self._needed - len(self._held)
