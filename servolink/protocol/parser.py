"""FrameParser: a byte stream, cut and damaged anyhow, to the intact frames in it.

The parser is total: any bytes are taken, none raises, and the same stream gives the same frames however it is
cut. A frame is believed when its id is known, its length obeys that id's rule and its sum is right. Otherwise
the search goes on inside it, so that no intact frame within a damaged one is lost.

One damaged frame in 256 has the right sum by chance and may have swallowed good ones. Three signs betray it,
and the parser then looks back for the frames inside: sync is lost right after it; a frame inside reaches into the
padding after it; or, on a line that was damaged lately, there are whole frames inside.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from struct import Struct
from typing import Literal, cast
from zlib import adler32

from servolink.protocol import speedups as compiled
from servolink.protocol.codec import PACKETS
from servolink.protocol.frame import (
    HEADER,
    HEADER_SIZE,
    MAGIC,
    MAX_CONTENT,
    OVERHEAD,
    BlockSums,
    ByteOrder,
    Frame,
    encode_frame,
    piecewise,
)
from servolink.protocol.layout import layout

REASONS = ("padding", "noise", "unknown id", "length", "checksum", "incomplete")
PADDING, NOISE, UNKNOWN_ID, LENGTH, CHECKSUM, INCOMPLETE = REASONS
"""Why bytes were skipped: zeros after a frame; no frame start; a frame start whose id, length or sum is wrong;
a frame that never ended."""

_ZEROS = re.compile(rb"\0*")
_MAX_KNOWN_HEADERS = 4096  # more would be a stream made to fill memory
_LONG = 4096  # contents above are summed in blocks that are remembered, so that overlapping claims stay cheap

_Entry = tuple[int, int, int, Struct | Literal[False] | None]
"""What a header implies: where the checksum stands, packet id, the header's share of the sum, and how to cut the
content to sum it: not at all, into pieces, or (False) into blocks that are remembered."""

_Cut = Callable[[bytes, int], tuple[bytes, int, bytes]]
"""Cuts a buffer, where a frame of a known length begins, into content, checksum and the next header."""
_Short = tuple[int, int, int, _Cut]
"""What the header of a short frame implies: its size, packet id, the header's sum, and how to cut it."""


class FrameParser:
    """Incremental parser for frames of every packet, requests and responses."""

    def __init__(self, byte_order: ByteOrder = "little", *, keep_skipped: bool = False) -> None:
        """With `keep_skipped` the skipped bytes themselves can be had from `take_skipped`."""
        self.byte_order: ByteOrder = byte_order
        self.frames = 0
        """Frames believed so far."""
        self.skipped: dict[str, int] = dict.fromkeys(REASONS, 0)
        """Bytes skipped so far, by reason."""
        self._entries: dict[bytes, _Entry] = {}
        self._known = self._entries.get  # bound once, for it is asked in every chunk
        self._short: dict[bytes, _Short] = {}  # few: lengths up to 256, and most packets have only one
        self._known_short = self._short.get
        self._held: bytes | bytearray = b""  # the incomplete rest; a bytearray while it grows in small steps
        self._needed = 0  # how long it must get before another look is worth it
        self._reason = PADDING
        self._in_sync = True  # nothing has been skipped since the last frame
        self._last: Frame | None = None  # the frame that ended here, but for `_zeros` zero bytes
        self._rest: bytes | None = None  # what is left to search of `_last`; None: all but its first byte
        self._zeros = 0
        self._shadow: FrameParser | None = None  # looks for a frame that reaches from `_last` into the padding
        self._shadowed: list[Frame] = []
        self._wary = 0  # so many more frames are searched for whole frames inside
        self._deepest = _DEEPEST
        self._replays: list[int] = []  # where in the buffer the bytes end that are read again, for each look back
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

    def give_up(self) -> list[Frame]:
        """Stop waiting for the rest of a begun frame and return the frames found inside it."""
        data = bytes(self._held)
        if len(data) < HEADER_SIZE:
            return self._scan(data, 0)  # it has claimed no length yet, and may be no frame at all
        self._reason, self._last, self._in_sync = INCOMPLETE, None, False
        self._skip(data, 0, len(MAGIC), [])
        return self._scan(data, len(MAGIC))

    def finish(self) -> list[Frame]:
        """End the stream: return the last frames and skip what never became one."""
        frames = self._scan(bytes(self._held), 0) if len(self._held) < HEADER_SIZE else []
        while len(self._held) >= HEADER_SIZE:
            earlier = self.take_skipped() if self._kept else []
            found = self.give_up()
            if self._kept is not None:
                self._kept = earlier + [(len(frames) + before, data, reason) for before, data, reason in self._kept]
            frames += found
        if self._held:
            self._reason = INCOMPLETE
            self._skip(bytes(self._held), 0, len(self._held), frames)
        self._held = b""
        return frames

    @property
    def begun(self) -> tuple[int, int, int] | None:
        """Packet id, bytes here and bytes wanted of the frame that is being received; None between frames."""
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
        settled = 0  # frames before the last loss of sync
        wary = self._wary
        length = len(data)
        needed = 0
        if compiled.collect is not None:
            at, wary = self._collect(compiled.collect, data, at, frames, wary)
        elif length > _MANY and not wary and self._short:
            at, needed = self._run(data, at, frames)
        while not needed:
            body = at + HEADER_SIZE
            entry = known(data[at:body])
            if entry is not None:
                last, packet_id, total, pieces = entry
                end = at + last
                if end >= length:
                    needed = last + 1
                    break
                content = data[body:end]
                if pieces is None:
                    total += adler32(content)
                elif pieces:
                    total += sum(map(adler32, pieces.unpack(content)))
                else:
                    total += self._block_sums().sum(data, body, end)
                if total & 0xFF == data[end]:
                    frames.append((packet_id, content))
                    at = end + 1
                    if wary:
                        wary -= 1
                        if last >= _ROOMY and MAGIC in content:
                            self._believed(frames[-1], at)
                            frames += self._swallowed()
                            settled = len(frames)
                    if at < length:
                        continue
            if at == length:
                needed = 1
                break
            if len(frames) > settled:
                settled = len(frames)
                self._believed(frames[-1], at)
            self._wary = wary
            data, at, needed = self._recover(data, at, frames, damaged=entry is not None)
            settled, length = len(frames), len(data)
            wary = self._wary
            if compiled.collect is not None and not needed:
                at, wary = self._collect(compiled.collect, data, at, frames, wary)
        if len(frames) > settled:
            self._believed(frames[-1], at)
        self._wary = wary
        self.frames += len(frames)
        self._held = data[at:]
        self._needed = needed
        if self._replays:
            self._replays = [end - at for end in self._replays]
        if self._blocks is not None:
            self._blocks.move(at)
        return frames

    def _collect(
        self, collect: compiled.Collect, data: bytes, at: int, frames: list[Frame], wary: int
    ) -> tuple[int, int]:
        """Let the compiled loop collect frames; return where they end, and for how many more to be wary."""
        before = len(frames)
        at = collect(data, at, self._entries, frames, wary)
        return at, max(0, wary - len(frames) + before)

    def _run(self, data: bytes, at: int, frames: list[Frame]) -> tuple[int, int]:
        """Collect short frames one behind the other, but for the last.

        Return where they end, and how many bytes are needed there if a short frame begins (else 0).
        One call cuts content, checksum and the next header, which is a fifth faster than three.
        """
        known = self._known_short
        room = len(data) - HEADER_SIZE
        header = data[at : at + HEADER_SIZE]
        while (short := known(header)) is not None:
            size, packet_id, total, cut = short
            same = header
            while header == same:  # as the next one is most of the time
                end = at + size
                if end > room:
                    return at, size if end > len(data) else 0
                content, check, header = cut(data, at)
                if adler32(content, total) & 0xFF != check:
                    return at, 0
                frames.append((packet_id, content))
                at = end
        return at, 0

    def _believed(self, frame: Frame, end: int) -> None:
        """Note that `frame` ends at `end`, in sync."""
        if self._replays:
            start = end - OVERHEAD - len(frame[1])
            self._replays = [again for again in self._replays if again > start]
        self._last = frame if len(self._replays) < self._deepest else None
        if self._in_sync:
            return
        self._in_sync = True
        self._rest = None
        self._shadow = None
        self._zeros = 0
        self._reason = PADDING

    def _recover(self, data: bytes, at: int, frames: list[Frame], *, damaged: bool) -> tuple[bytes, int, int]:
        """Go on where no frame is: return buffer, position, and how many bytes are needed there (0: scan on)."""
        head = data[at : at + HEADER_SIZE]
        if len(head) < HEADER_SIZE and MAGIC.startswith(head[: len(MAGIC)]):
            return data, at, HEADER_SIZE  # before which no frame can be known
        self._in_sync = False
        if head.startswith(MAGIC):
            reason = CHECKSUM if damaged else self._admit(head)
            if not reason:
                return data, at, 0
            self._reason, self._last = reason, None
            self._skip(data, at, at + len(MAGIC), frames)
            return data, at + len(MAGIC), 0  # one byte further would do: the magic cannot overlap itself
        if self._reason == PADDING:
            if not data[at]:
                return data, self._skip_zeros(data, at, frames), 0
            self._reason = NOISE
            if (last := self._last) is not None:
                self._last = None
                return *self._look_back(last, data, at), 0
        end = _next_magic(data, at + 1)
        self._skip(data, at, end, frames)
        return data, end, 0

    def _skip_zeros(self, data: bytes, at: int, frames: list[Frame]) -> int:
        match = _ZEROS.match(data, at)
        end = match.end() if match else at
        if self._last is not None and self._shadow is None:
            self._shadow_last(self._last)
        if self._last is None or self._shadow is None:
            self._skip(data, at, end, frames)
            return end
        if self._shadow._held:
            end = min(end, at + self._shadow._needed - len(self._shadow._held))
        self._zeros += end - at
        self._skip(data, at, end, frames)
        if reaching := self._shadow.feed(data[at:end]):
            frames += self._shadowed + reaching
            self._wary = _WARY
            self._go_on_as(self._shadow)
        elif (not self._shadow._held and not self._shadowed) or self._zeros > MAX_CONTENT:
            self._last = None  # nothing begins in it, or nothing reaches that far
        return end

    def _swallowed(self) -> list[Frame]:
        """Return the frames inside the last one, and keep of it only what may reach out of it."""
        if self._last is None:
            return []
        shadow, found = self._look_inside(self._last)
        if shadow._held:
            self._rest = bytes(shadow._held)
        else:
            self._go_on_as(shadow)
        self._in_sync = False
        return found

    def _go_on_as(self, shadow: FrameParser) -> None:
        """Take over what ended where `shadow` is, and perhaps zeros before that."""
        self._last, self._rest, self._zeros = shadow._last, shadow._rest, shadow._zeros
        self._shadow, self._shadowed = shadow._shadow, shadow._shadowed

    def _shadow_last(self, last: Frame) -> None:
        inside = self._inside(last)
        if _next_magic(inside, 0) < len(inside):
            self._shadow, self._shadowed = self._look_inside(last)
        else:
            self._last = None

    def _look_inside(self, frame: Frame) -> tuple[FrameParser, list[Frame]]:
        """Return a parser that has read what is in `frame`, and the frames it found."""
        shadow = FrameParser(self.byte_order)
        shadow._deepest = max(0, self._deepest - 1 - len(self._replays))
        shadow._wary = self._wary
        return shadow, shadow.feed(self._inside(frame))

    def _inside(self, frame: Frame) -> bytes:
        return encode_frame(*frame, self.byte_order)[1:] if self._rest is None else self._rest

    def _look_back(self, last: Frame, data: bytes, at: int) -> tuple[bytes, int]:
        """Return the buffer, with all of `last` in it, and where in `last` a frame may begin (else `at`)."""
        self._wary = _WARY
        again = self._inside(last) + bytes(self._zeros)
        start = _next_magic(again + data[at : at + len(MAGIC) - 1], 0)
        if start >= len(again):
            return data, at
        if len(again) > at:  # some of it was in the buffer before this one
            gone = len(again) - at
            data, at = again[:gone] + data, len(again)
            self._replays = [end + gone for end in self._replays]
            if self._blocks is not None:
                self._blocks.move(-gone)
        self._replays.append(at)
        return data, at - len(again) + start

    def _block_sums(self) -> BlockSums:
        if self._blocks is None:
            self._blocks = BlockSums()
        return self._blocks

    def _admit(self, header: bytes) -> str:
        """Learn what `header` implies; return why it cannot be one, empty if it can."""
        _, packet_id, length = HEADER[self.byte_order].unpack(header)
        declared = PACKETS.get(packet_id)
        if declared is None:
            return UNKNOWN_ID
        if not layout(declared, self.byte_order).rule.admits(length):
            return LENGTH
        if len(self._entries) >= _MAX_KNOWN_HEADERS:
            self._entries.clear()
        pieces: Struct | Literal[False] | None = piecewise(length) if length <= _LONG else False
        total = sum(header)
        if pieces is not False:
            total -= max(1, -(-length // 256))  # adler32 begins at one, for each piece
        self._entries[header] = length + HEADER_SIZE, packet_id, total, pieces
        if length <= _SHORT:
            self._short[header] = length + OVERHEAD, packet_id, sum(header) & 0xFF, _cutter(length)
        return ""

    def _skip(self, data: bytes, start: int, end: int, frames: list[Frame]) -> None:
        start = max(start, *self._replays) if self._replays else start
        if start >= end:
            return
        self.skipped[self._reason] += end - start
        if self._reason != PADDING:
            self._wary = _WARY
        if self._kept is not None:
            self._kept.append((len(frames), data[start:end], self._reason))


_SHORT = 255  # bytes of content whose sum adler32 can add to a header's and still be exact
_MANY = 512  # bytes of a chunk that may hold a run of frames
_ROOMY = 2 * HEADER_SIZE  # where the checksum of a frame stands that has room for another
_WARY = 256
_DEEPEST = 4  # times that a byte is read again at most


@cache
def _cutter(length: int) -> _Cut:
    return cast("_Cut", Struct(f"{HEADER_SIZE}x{length}sB{HEADER_SIZE}s").unpack_from)


def _next_magic(data: bytes, start: int) -> int:
    """Return where the magic, or at the end of `data` the beginning of one, stands next; its length if nowhere."""
    found = data.find(MAGIC, start)
    if found >= 0:
        return found
    for size in (3, 2, 1):
        if data.endswith(MAGIC[:size], start):
            return len(data) - size
    return len(data)
