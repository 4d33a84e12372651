"""NestedFrameFilter: bytes inside a frame that look like another frame, such as in a caption."""

from __future__ import annotations

from servolink.protocol import MAGIC, ByteOrder, Frame, encode_frame


class NestedFrameFilter:
    """Tells frames inside another frame, such as in a caption, from frames of the board.

    The parser returns those right behind the frame around them, in order.
    """

    def __init__(self, byte_order: ByteOrder) -> None:
        """Start without a frame."""
        self._byte_order: ByteOrder = byte_order
        self.inside = b""
        """Rest of the latest frame behind the inner frames returned so far; empty if no frame begins inside."""

    def hides(self, frame: Frame) -> bool:
        """Return whether `frame` begins inside the latest frame. If not, remember `frame` as the latest."""
        data = encode_frame(*frame, self._byte_order)
        begins = self._beginning(data)
        if begins is None:
            self.inside = data[1:] if MAGIC in frame[1] else b""
            return False
        self.inside = self.inside[begins + len(data) :]
        return True

    def _beginning(self, data: bytes) -> int | None:
        """Return the place of `data` in the latest frame, whole or up to the end of the frame."""
        at = self.inside.find(MAGIC)
        while at >= 0:
            if data.startswith(self.inside[at : at + len(data)]):
                return at
            at = self.inside.find(MAGIC, at + 1)
        return None
