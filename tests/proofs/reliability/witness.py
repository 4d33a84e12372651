"""A witness knows what was really sent, and so which of the frames that a parser believes are true."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from servolink.protocol import ByteOrder, Frame, FrameParser


class Witness:
    """Compares the frames that come out of one direction of a line with those that arrived whole."""

    def __init__(self) -> None:
        """Begin with an idle line."""
        self._coming: deque[tuple[Frame, int]] = deque()
        self.missed = 0
        """Frames that arrived whole and were not found."""
        self.false = 0
        """Frames that were believed and are none of those that arrived whole."""

    def expect(self, frame: Frame, number: int) -> None:
        """Note that `frame`, the one with this number, arrives whole."""
        self._coming.append((frame, number))

    def recognise(self, frame: Frame) -> int | None:
        """Return the number of a frame that was believed; None if nobody sent it so."""
        for at, (sent, number) in enumerate(self._coming):
            if sent == frame:
                for _ in range(at + 1):
                    self._coming.popleft()
                self.missed += at
                return number
        self.false += 1
        return None

    def forget(self) -> None:
        """Expect nothing of what was sent so far."""
        self._coming.clear()


class WitnessedParser(FrameParser):
    """The parser, every frame of which is shown to `seen` before it is acted on."""

    def __init__(self, byte_order: ByteOrder, seen: Callable[[Frame], None]) -> None:
        """Parse as usual."""
        super().__init__(byte_order)
        self._seen = seen

    def feed(self, chunk: bytes | bytearray | memoryview) -> list[Frame]:
        """Take the next bytes of the stream and return the frames that are now complete."""
        frames = super().feed(chunk)
        for frame in frames:
            self._seen(frame)
        return frames

    def abandon_frame(self) -> list[Frame]:
        """Stop waiting for the rest of a partial frame and return the frames inside it."""
        frames = super().abandon_frame()
        for frame in frames:
            self._seen(frame)
        return frames
