"""Recovery of frames swallowed by a damaged frame: a search inside the last accepted frame after signs of damage.

A damaged frame has the right sum by chance in 1 of 256 cases. A wrong length may then swallow intact frames or the
beginning of a frame. Three signs betray such a frame: sync is lost right behind the frame; a frame inside reaches
into the padding behind; or, on a line damaged lately, there are whole frames inside.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Protocol

from servolink.protocol.frame import MAGIC, MAX_CONTENT, OVERHEAD, ByteOrder, Frame, encode_frame

DEEPEST = 4
"""Maximum number of rereads of a byte: the bound on the cost of frames inside frames inside frames."""
_ZEROS = re.compile(rb"\0*")


class InnerParser(Protocol):
    """A parser for the inside of a frame."""

    @property
    def recovery(self) -> Recovery:
        """Recovery state of the inner parser."""
        ...

    @property
    def partial(self) -> bytes:
        """Bytes of the incomplete frame so far."""
        ...

    @property
    def missing(self) -> int:
        """Number of further bytes needed at least."""
        ...

    def feed(self, chunk: bytes) -> list[Frame]:
        """Take the next bytes, and return the frames completed by them."""
        ...


NewParser = Callable[[int, int], InnerParser]
"""Creates an inner parser. Arguments: depth of the search, number of frames to search for whole frames inside."""


class Recovery:
    """Last accepted frame of a stream, and the search inside the frame."""

    def __init__(self, byte_order: ByteOrder, new_parser: NewParser, deepest: int) -> None:
        """Start without a frame. Parsers from `new_parser` search inside frames, at most `deepest` levels deep."""
        self._byte_order: ByteOrder = byte_order
        self._new_parser = new_parser
        self._deepest = deepest
        self.in_sync = True
        """Whether nothing was skipped since the last frame."""
        self.last: Frame | None = None
        """Last frame, followed by `_zeros` zero bytes up to the parser's position; None without a need to search."""
        self.is_calm = False
        """Whether `accept` would only replace `last`: nothing skipped behind the frame, and no rescan under way."""
        self._rest: bytes | None = None  # part of `last` still to search; None: all but the first byte
        self._zeros = 0
        self._inner: InnerParser | None = None  # searches for a frame that reaches from `last` into the padding
        self._inside: list[Frame] = []  # frames found by `_inner` so far
        self.rereads: list[int] = []
        """End position, in the buffer, of the bytes read again in each rescan under way."""

    def accept(self, frame: Frame, end: int) -> None:
        """Record that `frame` ends at `end` of the buffer, in sync."""
        self.last = frame
        if self.rereads:  # a rescan counts as long as frames begin before the end of the rescan
            start = end - OVERHEAD - len(frame[1])
            self.rereads = [reread for reread in self.rereads if reread > start]
        if len(self.rereads) >= self._deepest:
            self.last = None  # nested too deeply for another search
        if not self.in_sync:
            self.in_sync, self._rest, self._inner, self._zeros = True, None, None, 0
        self.is_calm = self.last is not None and not self.rereads

    def lose_sync(self, *, search: bool = False) -> None:
        """Record that no frame follows the last frame; only with `search` may the last frame be searched later."""
        self.in_sync = self.is_calm = False
        if not search:
            self.last = None

    def take_inside(self, wary: int) -> list[Frame]:
        """Return the frames inside the last frame, and keep only the rest, which may reach beyond the end."""
        if self.last is None:
            return []
        inner, found = self._search(self.last, wary)
        if inner.partial:  # a frame begins near the end and may reach beyond
            self._rest = inner.partial
        else:
            self._go_on_as(inner.recovery)
        self.in_sync = self.is_calm = False  # so that the next frame replaces the rest kept here
        return found

    def padding_end(self, data: bytes, at: int, wary: int) -> int:
        """Return the end of the zeros at `at`, or the possible end of a frame that reaches into the zeros."""
        match = _ZEROS.match(data, at)
        end = match.end() if match else at
        if self.last is not None and self._inner is None:  # the first zeros behind the last frame
            inside = self._inside_of(self.last)
            if next_magic(inside, 0) < len(inside):
                self._inner, self._inside = self._search(self.last, wary)
            else:
                self.last = None
        if self.last is not None and self._inner is not None and self._inner.partial:
            end = min(end, at + self._inner.missing)
        return end

    def read_padding(self, zeros: bytes) -> list[Frame]:
        """Return the frames inside the last frame if a frame inside ends with these zeros, else an empty list."""
        if self.last is None or self._inner is None:
            return []
        self._zeros += len(zeros)
        if reaching := self._inner.feed(zeros):
            found = self._inside + reaching
            self._go_on_as(self._inner.recovery)
            return found
        if (not self._inner.partial and not self._inside) or self._zeros > MAX_CONTENT:
            self.last = None  # no frame begins inside, or none reaches so far
        return []

    def rescan(self, data: bytes, at: int) -> tuple[bytes, int] | None:
        """Return a buffer with the whole last frame, and the first place inside where another frame may begin.

        Return `data` and `at` if no frame may begin inside, None without a frame to search. The bytes put in front of
        `data` were in the buffer before.
        """
        last, self.last = self.last, None
        if last is None:
            return None
        again = self._inside_of(last) + bytes(self._zeros)
        start = next_magic(again + data[at : at + len(MAGIC) - 1], 0)
        if start >= len(again):
            return data, at
        if len(again) > at:  # part of the frame was in an earlier buffer
            count = len(again) - at
            data, at = again[:count] + data, len(again)
            self.rereads = [end + count for end in self.rereads]
        self.rereads.append(at)
        return data, at - len(again) + start

    def first_unread(self, start: int) -> int:
        """Return the position, from `start` on, of the first byte not read again."""
        return max(start, *self.rereads) if self.rereads else start

    def move(self, by: int) -> None:
        """Record that the start of the buffer moved by `by` bytes in the stream."""
        self.rereads = [end - by for end in self.rereads]

    def _search(self, frame: Frame, wary: int) -> tuple[InnerParser, list[Frame]]:
        """Return a parser after reading the inside of `frame`, and the frames found."""
        inner = self._new_parser(max(0, self._deepest - 1 - len(self.rereads)), wary)
        return inner, inner.feed(self._inside_of(frame))

    def _inside_of(self, frame: Frame) -> bytes:
        return encode_frame(*frame, self._byte_order)[1:] if self._rest is None else self._rest

    def _go_on_as(self, other: Recovery) -> None:
        """Take over the state of an inner parser at the same place of the stream."""
        self.last, self._rest, self._zeros = other.last, other._rest, other._zeros
        self._inner, self._inside = other._inner, other._inside


def next_magic(data: bytes, start: int) -> int:
    """Return the position of the next magic, or of a partial magic at the end of `data`; else the length of `data`."""
    found = data.find(MAGIC, start)
    if found >= 0:
        return found
    for size in range(len(MAGIC) - 1, 0, -1):
        if data.endswith(MAGIC[:size], start):
            return len(data) - size
    return len(data)
