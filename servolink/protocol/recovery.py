"""Frames swallowed by a damaged one: searched inside the last accepted frame when signs betray it.

One damaged frame in 256 has the right sum by chance. Its length may be wrong, so it may have swallowed intact frames
or the beginning of one. Three signs betray it: sync is lost right behind it; a frame inside it reaches into the
padding behind it; or, on a line that was damaged lately, there are whole frames inside.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Protocol

from servolink.protocol.frame import MAGIC, MAX_CONTENT, OVERHEAD, ByteOrder, Frame, encode_frame

DEEPEST = 4
"""How often a byte is read again at most: the bound on the cost of frames inside frames inside frames."""
_ZEROS = re.compile(rb"\0*")


class InnerParser(Protocol):
    """A parser for the inside of a frame."""

    @property
    def recovery(self) -> Recovery:
        """Its own recovery."""
        ...

    @property
    def held(self) -> bytes:
        """The bytes of the frame that it has not received whole."""
        ...

    @property
    def missing(self) -> int:
        """How many more bytes it needs at least."""
        ...

    def feed(self, chunk: bytes) -> list[Frame]:
        """Take the next bytes and return the frames that are now complete."""
        ...


NewParser = Callable[[int, int], InnerParser]
"""Makes an inner parser, given how deep it may search and how many frames it is to be wary of."""


class Recovery:
    """The last accepted frame of a stream, and what may be inside it."""

    def __init__(self, byte_order: ByteOrder, new_parser: NewParser, deepest: int) -> None:
        """Start without a frame; the inside is searched by what `new_parser` makes, `deepest` levels deep at most."""
        self._byte_order: ByteOrder = byte_order
        self._new_parser = new_parser
        self._deepest = deepest
        self.in_sync = True
        """Nothing has been skipped since the last frame."""
        self.last: Frame | None = None
        """The last frame, which ends `_zeros` zero bytes before the parser's position; None if it is not searched."""
        self.is_calm = False
        """Whether `accept` would only replace `last`: nothing was skipped behind it, and no rescan is under way."""
        self._rest: bytes | None = None  # the part of `last` still to be searched; None: all but its first byte
        self._zeros = 0
        self._inner: InnerParser | None = None  # looks for a frame that reaches from `last` into the padding
        self._inside: list[Frame] = []  # the frames it has found so far
        self.rereads: list[int] = []
        """For each rescan under way, where in the buffer the bytes end that are read again."""

    def accept(self, frame: Frame, end: int) -> None:
        """Record that `frame` ends at `end` of the buffer, in sync."""
        self.last = frame
        if self.rereads:  # a rescan counts as long as frames begin before its end
            start = end - OVERHEAD - len(frame[1])
            self.rereads = [reread for reread in self.rereads if reread > start]
        if len(self.rereads) >= self._deepest:
            self.last = None  # nested too deeply for another search
        if not self.in_sync:
            self.in_sync, self._rest, self._inner, self._zeros = True, None, None, 0
        self.is_calm = self.last is not None and not self.rereads

    def lose_sync(self, *, search: bool = False) -> None:
        """Record that no frame follows the last one, which is searched later only if `search`."""
        self.in_sync = self.is_calm = False
        if not search:
            self.last = None

    def take_inside(self, wary: int) -> list[Frame]:
        """Return the frames inside the last one, and keep only the rest of it, which may reach out of it."""
        if self.last is None:
            return []
        inner, found = self._search(self.last, wary)
        if inner.held:  # a frame begins at its end and may reach out of it
            self._rest = inner.held
        else:
            self._go_on_as(inner.recovery)
        self.in_sync = self.is_calm = False  # so that the next frame replaces what was kept here
        return found

    def padding_end(self, data: bytes, at: int, wary: int) -> int:
        """Return where the zeros at `at` end, or before that where a frame may end that reaches into them."""
        match = _ZEROS.match(data, at)
        end = match.end() if match else at
        if self.last is not None and self._inner is None:  # the first zeros behind this frame
            inside = self._inside_of(self.last)
            if next_magic(inside, 0) < len(inside):
                self._inner, self._inside = self._search(self.last, wary)
            else:
                self.last = None
        if self.last is not None and self._inner is not None and self._inner.held:
            end = min(end, at + self._inner.missing)
        return end

    def read_padding(self, zeros: bytes) -> list[Frame]:
        """Return the frames inside the last one if one of them ends with these zeros, else an empty list."""
        if self.last is None or self._inner is None:
            return []
        self._zeros += len(zeros)
        if reaching := self._inner.feed(zeros):
            found = self._inside + reaching
            self._go_on_as(self._inner.recovery)
            return found
        if (not self._inner.held and not self._inside) or self._zeros > MAX_CONTENT:
            self.last = None  # nothing begins in it, or nothing reaches that far
        return []

    def rescan(self, data: bytes, at: int) -> tuple[bytes, int] | None:
        """Return a buffer with all of the last frame in it, and where in that frame another may begin.

        Return `data` and `at` if none may begin in it, None if there is no frame to search. The bytes put in front of
        `data` were in the buffer before.
        """
        last, self.last = self.last, None
        if last is None:
            return None
        again = self._inside_of(last) + bytes(self._zeros)
        start = next_magic(again + data[at : at + len(MAGIC) - 1], 0)
        if start >= len(again):
            return data, at
        if len(again) > at:  # some of it was in an earlier buffer
            gone = len(again) - at
            data, at = again[:gone] + data, len(again)
            self.rereads = [end + gone for end in self.rereads]
        self.rereads.append(at)
        return data, at - len(again) + start

    def first_unread(self, start: int) -> int:
        """Return where the first byte from `start` on stands that is not read again."""
        return max(start, *self.rereads) if self.rereads else start

    def move(self, by: int) -> None:
        """Record that the buffer now begins `by` bytes further on in the stream."""
        self.rereads = [end - by for end in self.rereads]

    def _search(self, frame: Frame, wary: int) -> tuple[InnerParser, list[Frame]]:
        """Return a parser that has read the inside of `frame`, and the frames it found."""
        inner = self._new_parser(max(0, self._deepest - 1 - len(self.rereads)), wary)
        return inner, inner.feed(self._inside_of(frame))

    def _inside_of(self, frame: Frame) -> bytes:
        return encode_frame(*frame, self._byte_order)[1:] if self._rest is None else self._rest

    def _go_on_as(self, other: Recovery) -> None:
        """Take over the state of an inner parser, which has reached the same place."""
        self.last, self._rest, self._zeros = other.last, other._rest, other._zeros
        self._inner, self._inside = other._inner, other._inside


def next_magic(data: bytes, start: int) -> int:
    """Return where the magic, or at the end of `data` the beginning of one, stands next; its length if nowhere."""
    found = data.find(MAGIC, start)
    if found >= 0:
        return found
    for size in range(len(MAGIC) - 1, 0, -1):
        if data.endswith(MAGIC[:size], start):
            return len(data) - size
    return len(data)
